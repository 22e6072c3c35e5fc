"""Every filter keeps the promises of `CandidateFilter`."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import ConfigError, InputError
from wiclosure.types import Trajectory, WirelessLog, WirelessMeasurement, robot_pairs
from wiclosure.wiclosure_filter.baselines import OracleFilter, RandomFilter, RangeGateFilter
from wiclosure.wiclosure_filter.config import FilterSettings, OracleSettings, RandomSettings, RangeGateSettings
from wiclosure.wiclosure_filter.registry import FILTERS, make_filter


def straight(robot: str, size: int, y_m: float = 0.0, reverse: bool = False) -> Trajectory:
    x = 2.0 * np.arange(size)[:: -1 if reverse else 1]
    poses = se3.from_yaw(np.full(size, np.pi if reverse else 0.0), np.stack([x, np.full(size, y_m), 0 * x], axis=1))
    return Trajectory(robot, np.arange(size, dtype=np.int64) * 10**9, poses)


@pytest.fixture
def world() -> dict[str, Trajectory]:
    """True trajectories of three robots on one road."""
    return {
        "alpha": straight("alpha", 60),
        "beta": straight("beta", 50, 5.0, reverse=True),
        "gamma": straight("gamma", 1, 9.0),
    }


@pytest.fixture
def odometry(world: dict[str, Trajectory]) -> dict[str, Trajectory]:
    return {name: truth.moved(se3.inverse(truth.poses[0])) for name, truth in world.items()}


def ranges(world: dict[str, Trajectory]) -> WirelessLog:
    return WirelessLog(
        tuple(
            WirelessMeasurement(
                stamp_ns=int(stamp),
                receiver="beta",
                transmitter="alpha",
                range_m=float(
                    np.linalg.norm(world["alpha"].at(np.array([stamp])) - world["beta"].at(np.array([stamp])))
                ),
                range_sigma_m=0.5,
            )
            for stamp in world["beta"].stamps_ns[::4]
        )
    )


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


def test_none_keeps_all(odometry: dict[str, Trajectory]) -> None:
    result = make_filter("none").candidates(odometry, WirelessLog())
    assert result.pairs_kept == result.pairs_total


def test_more_pairs_than_memory_is_one_sentence() -> None:
    long = straight("alpha", 1_000_00)
    with pytest.raises(InputError, match="too many to list"):
        make_filter("none").candidates({"alpha": long, "beta": straight("beta", 1_000_00)}, WirelessLog())


def test_random_keeps_the_share_and_follows_the_seed(odometry: dict[str, Trajectory]) -> None:
    kept = [
        RandomFilter(RandomSettings(keep_rate=0.1, seed=seed)).candidates(odometry, WirelessLog()).pairs[0]
        for seed in (1, 1, 2)
    ]
    assert [len(k) for k in kept] == [300] * 3
    np.testing.assert_array_equal(kept[0].index_b, kept[1].index_b)
    assert not np.array_equal(kept[0].index_b, kept[2].index_b)


def test_oracle_keeps_exactly_the_near_pairs(world: dict[str, Trajectory], odometry: dict[str, Trajectory]) -> None:
    result = OracleFilter(world, OracleSettings(radius_m=20.0)).candidates(odometry, WirelessLog())
    for pairs in result.pairs:
        a, b = world[pairs.robot_a].positions, world[pairs.robot_b].positions
        near = np.linalg.norm(a[:, None] - b, axis=2) <= 20.0
        np.testing.assert_array_equal(np.argwhere(near), np.stack([pairs.index_a, pairs.index_b], axis=1))


def test_oracle_predicts_the_true_poses(world: dict[str, Trajectory], odometry: dict[str, Trajectory]) -> None:
    pairs = OracleFilter(world, OracleSettings(radius_m=20.0)).candidates(odometry, WirelessLog()).pairs[0]
    prediction = pairs.predicted(np.arange(len(pairs)))
    assert prediction is not None
    expected = se3.between(world["alpha"].poses[pairs.index_a], world["beta"].poses[pairs.index_b])
    np.testing.assert_allclose(prediction[0], expected, atol=1e-12)


def test_oracle_predicts_nothing_by_truth_in_other_axes(
    world: dict[str, Trajectory], odometry: dict[str, Trajectory]
) -> None:
    sideways = se3.from_yaw(np.array([np.pi / 2]), np.zeros((1, 3)))[0]
    turned = world | {"beta": Trajectory("beta", world["beta"].stamps_ns, world["beta"].poses @ sideways)}
    result = OracleFilter(turned, OracleSettings()).candidates(odometry, WirelessLog())
    assert [pairs.predicts is None for pairs in result.pairs] == [True, False, True]
    assert len(result.diagnosis) == 1
    assert "beta" in result.diagnosis[0]


def test_oracle_needs_ground_truth(world: dict[str, Trajectory], odometry: dict[str, Trajectory]) -> None:
    with pytest.raises(ConfigError, match="needs ground truth"):
        make_filter("oracle")
    with pytest.raises(InputError, match="no ground truth of beta"):
        make_filter("oracle", ground_truth={"alpha": world["alpha"]}).candidates(odometry, WirelessLog())


def test_range_gate_keeps_pairs_around_short_ranges(
    world: dict[str, Trajectory], odometry: dict[str, Trajectory]
) -> None:
    settings = RangeGateSettings(max_range_m=10.0, window_m=6.0)
    pairs = RangeGateFilter(settings).candidates(odometry, ranges(world)).pairs
    assert 0 < len(pairs[0]) < 3000
    # The robots meet at x = 49 m, second 24.5: nothing far from there may be proposed.
    assert abs(pairs[0].index_a - 24.5).max() < 10
    assert len(pairs[1]) == len(pairs[2]) == 0


def test_range_gate_ignores_what_it_cannot_place(odometry: dict[str, Trajectory]) -> None:
    late = WirelessMeasurement(10**12, "alpha", "beta", range_m=1.0, range_sigma_m=0.5)
    result = make_filter("range-gate").candidates(odometry, WirelessLog((late,)))
    assert result.pairs_kept == 0


def test_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"'wifi'; choose one of wiclosure, none, random"):
        make_filter("wifi", FilterSettings())
