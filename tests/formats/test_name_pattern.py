"""Families of names, matched and filled."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.errors import ConfigError
from wiclosure.formats.name_pattern import NamePattern


@pytest.mark.parametrize(
    ("pattern", "name", "ids"),
    [
        ("/uwb/tof/n_{a}/n_{b}/distance", "/uwb/tof/n_2/n_5/distance", {"from": "2", "to": "5"}),
        ("/uwb/{to}/{from}", "/uwb/2/5", {"to": "2", "from": "5"}),
        ("/range_{id}", "/range_7", {"to": "7"}),
        ("{from:d}_{to:d}", "1_6", {"from": "1", "to": "6"}),
        ("{from:d}_{to:d}", "A_x", None),
        ("{from:d}_{to:d}", "1_1_std", None),
        ("/uwb/{to}", "/uwb/2/5", None),
        ("/plain", "/plain", {}),
    ],
)
def test_matches(pattern: str, name: str, ids: dict[str, str] | None) -> None:
    assert NamePattern(pattern).match(name) == ids


@given(st.from_regex(r"[a-z0-9]{1,5}", fullmatch=True), st.from_regex(r"[a-z0-9]{1,5}", fullmatch=True))
def test_what_is_filled_in_is_found_again(one: str, other: str) -> None:
    pattern = NamePattern("/n.{from}/[{to}]")
    assert pattern.match(pattern.filled({"from": one, "to": other})) == {"from": one, "to": other}


def test_too_many_places() -> None:
    with pytest.raises(ConfigError, match="at most"):
        NamePattern("/{a}/{b}/{c}")
