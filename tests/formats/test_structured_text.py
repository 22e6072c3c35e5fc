from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.errors import InputError
from wiclosure.formats.structured_text import LARGEST_YAML, parse_json, parse_yaml, read_json, read_yaml


@pytest.mark.parametrize("text", ["0010", "0x0A1B", "1_1", "12:30", "DE:CA:00:07", "0b11", "1e05", "12:30:45.5"])
def test_ids_stay_what_is_written(text: str) -> None:
    assert parse_yaml(f"robots: {{{text}: alpha}}") == {"robots": {text: "alpha"}}


@given(st.integers(-(10**18) + 1, 10**18 - 1) | st.floats(allow_nan=False).filter(lambda x: "e" not in repr(x)))
def test_decimal_numbers_are_numbers(number: float) -> None:
    text = "-.inf" if number == -math.inf else ".inf" if number == math.inf else repr(number)
    assert parse_yaml(f"a: {text}") == {"a": number}


def test_other_values_are_as_ever() -> None:
    assert parse_yaml("{a: true, b: null, c: text, d: [1.5e+3, -2.], e: ~}") == {
        "a": True, "b": None, "c": "text", "d": [1500.0, -2.0], "e": None
    }  # fmt: skip


NESTED = {
    "lists": "[" * 1000 + "]" * 1000,
    "mappings": "{a: " * 1000 + "1" + "}" * 1000,
    "lines": "\n".join(" " * n + "a:" for n in range(1000)),
}


@pytest.mark.parametrize("text", NESTED.values(), ids=NESTED)
def test_deep_yaml_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="nested deeper than 64"):
        parse_yaml(text)


def test_yaml_of_aliases_of_aliases_is_refused_at_once() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 10)]
    with pytest.raises(InputError, match=r"^line 6: more than 200000 values, with what \*aliases stand for$"):
        parse_yaml("\n".join(lines))


def test_aliases_that_robots_share_their_settings_by_are_expanded() -> None:
    text = "common: &c {topic: /points, offset: 0.5}\nalpha: {<<: *c, scans: a.bag}\nbeta: *c"
    assert parse_yaml(text)["alpha"] == {"topic": "/points", "offset": 0.5, "scans": "a.bag"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: &a [*a]", r"line 1: \*a stands for nothing above"),
        ("a: 1\na: 2", r"line 2: 'a' stands twice"),
        ("a: 1.0e999", "line 1: 1.0e999 is too large"),
        ("a:\n\tb: 1", "line 2: .*; indent by spaces, not by tabs"),
        ("a: !!int x", "a value cannot be made"),
        ("a: !!int ''", "a value cannot be made"),
        ("a: !!timestamp x", "a value cannot be made"),
        ("a: !!python/object/apply:os.system [true]", "could not determine a constructor"),
        ('a: "\\0"', "line 1: a zero byte"),
        ("{[a]: 1}", "a key is a list or mapping"),
        ("a" * (LARGEST_YAML + 1), "more than 4 MB of YAML"),
    ],
)
def test_what_is_wrong_with_yaml_is_said(text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        parse_yaml(text)


@pytest.mark.parametrize("text", ["9" * 5000, "9" * 30, "2024-01-02", "2024-99-99"])
def test_long_numbers_and_dates_are_text(text: str) -> None:
    assert parse_yaml(text) == text


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[" * 65 + "]" * 65, "nested deeper than 64"),
        ('{"a":' * 100_000 + "1" + "}" * 100_000, "nested deeper than 64"),
        ('["]]]]]",' * 65 + "1" + "]" * 65, "nested deeper than 64"),
        ("[" * 100_000, "nested deeper than 64"),
        ("9" * 5000, "999... is too large or small"),
        ("1e999", "1e999 is too large or small"),
        ("1e99999999999999999999", "not valid JSON"),
        ('{"a": 1, "a": 2}', "'a' stands twice"),
        ('"\\ud800"', "half of a character"),
        ('"\\u0000"', "a zero byte"),
        ("{", "Expecting property name"),
        (b"\xff", "byte 0 is not UTF-8"),
    ],
)
def test_what_is_wrong_with_json_is_said(text: str | bytes, said: str, exact: bool) -> None:
    with pytest.raises(InputError, match=said):
        parse_json(text, exact=exact)


@given(st.recursive(st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats(allow_nan=False,
       allow_infinity=False) | st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0")),
       lambda inner: st.lists(inner) | st.dictionaries(st.text(st.characters(exclude_categories=["Cs"],
       exclude_characters="\0")), inner), max_leaves=20))  # fmt: skip
def test_all_other_json_is_what_it_was(value: object) -> None:
    assert parse_json(json.dumps(value)) == value


def test_brackets_in_texts_do_not_count() -> None:
    assert parse_json(json.dumps(["[" * 200, '\\"[[' * 100])) == ["[" * 200, '\\"[[' * 100]


def test_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text("a: 1\nb: [")
    with pytest.raises(InputError, match=r"x.yaml, line [23]: "):
        read_yaml(path)
    with pytest.raises(InputError, match=r"x.yaml: not valid JSON"):
        read_json(path)
    for read in (read_yaml, read_json):
        with pytest.raises(InputError, match=r"cannot read .*absent"):
            read(tmp_path / "absent")
