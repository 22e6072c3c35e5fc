"""Every filter keeps the promises of `CandidateFilter`."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.errors import ConfigError, InputError
from wiclosure.types import Trajectory, WirelessLog, robot_pairs
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.registry import FILTERS, make_filter

from .one_road import ranges, straight


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("heard", [True, False])
def test_every_filter_keeps_its_promises(
    name: str, heard: bool, world: dict[str, Trajectory], odometry: dict[str, Trajectory]
) -> None:
    wireless = ranges(world) if heard else WirelessLog()
    chosen = make_filter(name, ground_truth=world)
    result = chosen.candidates(odometry, wireless)
    again = make_filter(name, ground_truth=world).candidates(odometry, wireless)

    assert chosen.name == name == result.filter_name
    assert [(p.robot_a, p.robot_b) for p in result.pairs] == list(robot_pairs(list(odometry)))
    assert result.pairs_total == 60 * 50 + 60 + 50
    assert result.pairs_kept == sum(len(p) for p in result.pairs) <= result.pairs_total
    for pairs, repeated in zip(result.pairs, again.pairs, strict=True):
        assert pairs.index_a.dtype == pairs.index_b.dtype == np.int64
        size_b = len(odometry[pairs.robot_b])
        codes = pairs.index_a * size_b + pairs.index_b
        assert (np.diff(codes) > 0).all(), "sorted by a, then b; no pair twice"
        if len(codes):
            assert pairs.index_a.min() >= 0
            assert pairs.index_a.max() < len(odometry[pairs.robot_a])
            assert pairs.index_b.min() >= 0
            assert pairs.index_b.max() < size_b
        known = pairs.overlap_probability[~np.isnan(pairs.overlap_probability)]
        assert ((known >= 0) & (known <= 1)).all()
        np.testing.assert_array_equal(codes, repeated.index_a * size_b + repeated.index_b, "the same twice")
        prediction = pairs.predicted(np.arange(min(len(pairs), 5)))
        if prediction is not None:
            T_a_b, covariance = prediction
            assert T_a_b.shape == (min(len(pairs), 5), 4, 4)
            assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_more_pairs_than_memory_is_one_sentence() -> None:
    long = straight("alpha", 1_000_00)
    with pytest.raises(InputError, match="too many to list"):
        make_filter("none").candidates({"alpha": long, "beta": straight("beta", 1_000_00)}, WirelessLog())


def test_oracle_needs_ground_truth(world: dict[str, Trajectory], odometry: dict[str, Trajectory]) -> None:
    with pytest.raises(ConfigError, match="needs ground truth"):
        make_filter("oracle")
    with pytest.raises(InputError, match="no ground truth of beta"):
        make_filter("oracle", ground_truth={"alpha": world["alpha"]}).candidates(odometry, WirelessLog())


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"'wifi'; choose one of wiclosure, none, random"):
        make_filter("wifi", FilterSettings())
