from __future__ import annotations

import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.radio.readers.tag_names import TagNames, canonical, number_at_end
from wiclosure.pipeline.radio.source import RadioSource


def names(known: list[str] | None, **settings: object) -> TagNames:
    return TagNames(RadioSource.model_validate({"path": "uwb.csv", **settings}), known)


@pytest.mark.parametrize(("one", "other"), [("7", "7.0"), (7, "07"), ("022E", "022e"), (7.0, " +7 "), ("-3", "-3.")])
def test_ids_that_are_one_tag(one: object, other: object) -> None:
    assert canonical(one) == canonical(other)


@pytest.mark.parametrize(("one", "other"), [("7", "7.5"), ("7", "70"), ("022E", "022"), ("1e3", "1000")])
def test_ids_that_are_two_tags(one: str, other: str) -> None:
    assert canonical(one) != canonical(other)


def test_tags_are_mapped_to_robots_that_there_are() -> None:
    tags = names(["alpha", "beta"], robots={7: "alpha", "A1": "gone"}, anchors=[101])
    assert tags.robot("7.0") == "alpha"
    assert tags.robot("a1") is None  # of a robot that is not there
    assert tags.robot("beta") == "beta"  # named by itself
    assert tags.robot("12") is None
    assert tags.is_anchor("101.0")
    assert not tags.is_anchor("7")


def test_where_the_robots_are_not_known_every_name_is_taken_unless_there_is_a_mapping() -> None:
    assert names(None).robot(" beta ") == "beta"
    assert names(None).robot("") is None
    assert names(None, robots={7: "alpha"}).robot("9") is None
    assert names(None, robots={7: "alpha"}).robot(7) == "alpha"


def test_robots_by_the_number_at_their_end() -> None:
    tags = names(["turtle01", "turtle02"], robots="by number")
    assert (tags.robot(2), tags.robot("1.0"), tags.robot(3)) == ("turtle02", "turtle01", None)
    assert number_at_end("turtle02") == 2
    assert number_at_end("2turtle") is None


@pytest.mark.parametrize("known", [["r1", "s1"], ["alpha", "r2"], None])
def test_numbers_that_do_not_tell_robots_apart_are_refused(known: list[str] | None) -> None:
    with pytest.raises(InputError, match=r"^uwb\.csv: .*map the ids instead"):
        names(known, robots="by number")
