"""The filters to compare with, on one road that three robots share."""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.types import Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.baselines import NoFilter, OracleFilter, RandomFilter, RangeGateFilter

from .one_road import ranges


def test_none_keeps_all(odometry: dict[str, Trajectory]) -> None:
    result = NoFilter().candidates(odometry, WirelessLog())
    assert result.pairs_kept == result.pairs_total


def test_random_keeps_the_share_and_follows_the_seed(odometry: dict[str, Trajectory]) -> None:
    kept = [RandomFilter(keep_rate=0.1, seed=seed).candidates(odometry, WirelessLog()).pairs[0] for seed in (1, 1, 2)]
    assert [len(k) for k in kept] == [300] * 3
    np.testing.assert_array_equal(kept[0].index_b, kept[1].index_b)
    assert not np.array_equal(kept[0].index_b, kept[2].index_b)


def test_oracle_keeps_exactly_the_near_pairs(world: dict[str, Trajectory], odometry: dict[str, Trajectory]) -> None:
    result = OracleFilter(world, radius_m=20.0).candidates(odometry, WirelessLog())
    for pairs in result.pairs:
        a, b = world[pairs.robot_a].positions, world[pairs.robot_b].positions
        near = np.linalg.norm(a[:, None] - b, axis=2) <= 20.0
        np.testing.assert_array_equal(np.argwhere(near), np.stack([pairs.index_a, pairs.index_b], axis=1))


def test_oracle_predicts_the_true_poses(world: dict[str, Trajectory], odometry: dict[str, Trajectory]) -> None:
    pairs = OracleFilter(world, radius_m=20.0).candidates(odometry, WirelessLog()).pairs[0]
    prediction = pairs.predicted(np.arange(len(pairs)))
    assert prediction is not None
    expected = se3.between(world["alpha"].poses[pairs.index_a], world["beta"].poses[pairs.index_b])
    np.testing.assert_allclose(prediction[0], expected, atol=1e-12)


def test_oracle_predicts_nothing_by_truth_in_other_axes(
    world: dict[str, Trajectory], odometry: dict[str, Trajectory]
) -> None:
    sideways = se3.from_yaw(np.array([np.pi / 2]), np.zeros((1, 3)))[0]
    turned = world | {"beta": Trajectory("beta", world["beta"].stamps_ns, world["beta"].poses @ sideways)}
    result = OracleFilter(turned, radius_m=35.0).candidates(odometry, WirelessLog())
    assert [pairs.predictor is None for pairs in result.pairs] == [True, False, True]
    assert len(result.diagnosis) == 1
    assert "beta" in result.diagnosis[0]


def test_range_gate_keeps_pairs_around_short_ranges(
    world: dict[str, Trajectory], odometry: dict[str, Trajectory]
) -> None:
    pairs = RangeGateFilter(max_range_m=10.0, window_m=6.0).candidates(odometry, ranges(world)).pairs
    assert 0 < len(pairs[0]) < 3000
    # The robots meet at x = 49 m, second 24.5: nothing far from there may be proposed.
    assert abs(pairs[0].index_a - 24.5).max() < 10
    assert len(pairs[1]) == len(pairs[2]) == 0


def test_range_gate_ignores_what_it_cannot_place(odometry: dict[str, Trajectory]) -> None:
    late = WirelessMeasurement(10**12, "alpha", "beta", range_m=1.0, range_sigma_m=0.5)
    result = RangeGateFilter(max_range_m=35.0, window_m=35.0).candidates(odometry, WirelessLog((late,)))
    assert result.pairs_kept == 0


def test_range_gate_windows_are_measured_along_the_road(odometry: dict[str, Trajectory]) -> None:
    """Keyframes stand 2 m apart: a window of 4 m holds two on either side."""
    heard = WirelessMeasurement(
        20 * 10**9, "alpha", "beta", range_m=5.0, range_sigma_m=0.5, transmitter_stamp_ns=10**10
    )
    pairs = RangeGateFilter(max_range_m=6.0, window_m=4.0).candidates(odometry, WirelessLog((heard,))).pairs[0]
    assert np.unique(pairs.index_a).tolist() == [18, 19, 20, 21, 22]
    assert np.unique(pairs.index_b).tolist() == [8, 9, 10, 11, 12]
    assert len(pairs) == 25
    shorter = RangeGateFilter(max_range_m=4.0, window_m=4.0)
    assert shorter.candidates(odometry, WirelessLog((heard,))).pairs_kept == 0
