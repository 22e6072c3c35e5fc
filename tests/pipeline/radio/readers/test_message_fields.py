from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from wiclosure.errors import ConfigError, InputError
from wiclosure.pipeline.radio.readers.message_fields import FieldPath, field_paths, rows_of


@dataclass
class Node:
    id: int
    dis: float


@dataclass
class Message:
    stamp: int
    nodes: list[Node]
    ranges: np.ndarray
    name: str = "tag"
    __msgtype__: str = "lab_msgs/msg/Uwb"


MESSAGE = Message(5, [Node(1, 2.5), Node(2, 3.5)], np.array([7.0, 8.0, 9.0]))


def rows(**paths: str) -> list[dict[str, Any]]:
    return list(rows_of(MESSAGE, {key: FieldPath.parsed(path) for key, path in paths.items()}))


def test_a_row_for_each_element_of_an_array_with_the_plain_fields_repeated() -> None:
    assert rows(stamp="stamp", to="nodes[].id", range="nodes[].dis") == [
        {"stamp": 5, "to": 1, "range": 2.5},
        {"stamp": 5, "to": 2, "range": 3.5},
    ]
    assert [row["range"] for row in rows(range="ranges[]")] == [7.0, 8.0, 9.0]
    assert rows(stamp="stamp", range="ranges[1]") == [{"stamp": 5, "range": 8.0}]
    assert rows(range="nodes[1].dis") == [{"range": 3.5}]


def test_an_element_beyond_the_end_is_nothing() -> None:
    assert rows(range="ranges[3]") == [{"range": None}]


@pytest.mark.parametrize(
    ("path", "says"),
    [
        ("range", r"lab_msgs/msg/Uwb has no field 'range' \(of 'range'\); its fields: stamp, nodes, ranges, name"),
        ("nodes[].distance", r"Node has no field 'distance' .* its fields: id, dis"),
        ("stamp[]", r"field 'stamp' of 'stamp\[\]' is no array; leave the \[\] out"),
        ("name[0]", "is no array"),
    ],
)
def test_a_field_that_is_not_there_is_named_with_those_that_are(path: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        rows(range=path)


def test_arrays_of_different_lengths_do_not_make_rows() -> None:
    with pytest.raises(InputError, match=r"the arrays of ranges\[\], nodes\[\]\.id differ in length"):
        rows(range="ranges[]", to="nodes[].id")


@pytest.mark.parametrize("text", ["", "a..b", "a[x]", "a b", ".a", "a[]]"])
def test_what_is_no_path_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="is no field of a message; expected a path such as"):
        FieldPath.parsed(text)


def test_one_array_is_possible() -> None:
    with pytest.raises(ConfigError, match=r"'a\[\]\.b\[\]' goes through two arrays"):
        FieldPath.parsed("a[].b[]")
    assert FieldPath.parsed("a[0].b[]").is_array
    assert not FieldPath.parsed("a[0].b").is_array


def test_the_paths_of_all_fields_can_be_read() -> None:
    paths = field_paths(MESSAGE)
    assert paths == ["stamp", "nodes[].id", "nodes[].dis", "ranges[]", "name"]
    assert all(FieldPath.parsed(path).of(MESSAGE) is not None for path in paths)


def test_an_array_without_brackets_names_the_way_out() -> None:
    with pytest.raises(InputError, match=r"'nodes' of 'nodes.dis' is an array; write nodes\[\].dis for each element"):
        rows(range="nodes.dis")
