"""Robots of a team that cannot meet are left out, and stretches that cannot; no pair is lost by that."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import AoaPath, FloatArray, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings, FilterSettings, GateSettings
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.search.gates import make_gate
from wiclosure.wiclosure_filter.search.overlap_search import find_overlap
from wiclosure.wiclosure_filter.shared.shared_trajectory import SharedTrajectory

SIZE = 120
NAMES = ("a", "b", "c", "d", "e")


def row_of_robots(seed: int) -> tuple[dict[str, Trajectory], WirelessLog]:
    """Five robots, each on its own wavy road beside the one before: only neighbours hear each other, or can meet."""
    rng = np.random.default_rng(seed)
    along = np.arange(SIZE) * 2.0
    truth, odometry, heard = {}, {}, []
    for number, name in enumerate(NAMES):
        x, y = along, 70.0 * number + 30.0 * np.sin(along / 40.0 + number)
        yaw = np.arctan2(np.gradient(y), np.gradient(x))
        truth[name] = se3.from_yaw(yaw, np.stack([x, y, 0 * x], axis=1))
        steps = se3.between(truth[name][:-1], truth[name][1:]) @ se3.exp(
            np.array([0, 0, 0.002, 0.03, 0.03, 0.0]) * rng.normal(size=(SIZE - 1, 6))
        )
        odometry[name] = Trajectory(name, np.arange(SIZE) * 10**9, chained(steps))
    for a, b in pairwise(NAMES):
        seen = se3.between(truth[a], truth[b])[:, :3, 3]
        for k in range(0, SIZE, 8):
            azimuth = float(np.arctan2(seen[k, 1], seen[k, 0]) + rng.normal(0, 0.1))
            metres = float(np.linalg.norm(seen[k]) + rng.normal(0, 0.3))
            path = AoaPath(float(se3.wrap_angle(azimuth)), 0.1)
            heard.append(WirelessMeasurement(k * 10**9, a, b, metres, 0.3, (path,)))
    return odometry, WirelessLog(tuple(sorted(heard, key=lambda m: m.stamp_ns)))


def chained(steps: FloatArray) -> FloatArray:
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    return np.array(poses)


def shared_by(chosen: WiClosureFilter, seed: int) -> SharedTrajectory:
    odometry, wireless = row_of_robots(seed)
    links = chosen.gather(odometry, wireless).by_pair
    return chosen.share(odometry, links, list(chosen.align(odometry, links).values()))


@pytest.mark.parametrize("gravity_aligned", [True, False])
@pytest.mark.parametrize("method", ["overlap_probability", "mahalanobis"])
def test_what_is_left_out_the_gate_would_not_keep(gravity_aligned: bool, method: str) -> None:
    alignment = AlignmentSettings(gravity_aligned=gravity_aligned)
    gated = GateSettings.model_validate({"method": method, "sensor_range_m": 20.0, "mahalanobis_threshold": 1.0})
    chosen = WiClosureFilter(FilterSettings(alignment=alignment, gate=gated))
    gate, shared = make_gate(gated), shared_by(chosen, seed=0)
    near = shared.may_meet(gate)
    assert shared.estimates
    assert len(near) < len(shared.estimates) or not gravity_aligned  # in space the radio tells little of height
    for pair, estimate in shared.estimates.items():
        (whole,) = estimate.models(*pair)
        every, parts = find_overlap(whole, gate), [find_overlap(m, gate) for m in estimate.models(*pair, gate)]
        assert pair in near or len(every.index_a) == 0
        assert len(parts) == 1 or len(every.index_a) == 0
        for part in parts:
            np.testing.assert_array_equal(part.index_a, every.index_a)
            np.testing.assert_array_equal(part.index_b, every.index_b)
            np.testing.assert_allclose(part.overlap_probability, every.overlap_probability, atol=1e-6)


def test_pairs_are_ranked_by_robots_that_share_much() -> None:
    """Each robot comes right after others of its part of the row; the order of the pairs given does not count."""
    shared = shared_by(WiClosureFilter(), seed=0)
    pairs = list(shared.estimates)
    ranked = shared.by_rank(pairs)
    assert sorted(ranked) == sorted(pairs)
    assert shared.by_rank(reversed(pairs)) == ranked
    (estimate,) = set(shared.estimates.values())
    robots = sorted({robot for pair in pairs for robot in pair}, key=estimate.rank)
    assert sorted(map(estimate.rank, robots)) == list(range(len(robots)))
    assert [max(map(robots.index, pair)) for pair in ranked] == sorted(max(map(robots.index, pair)) for pair in pairs)


def test_tables_are_no_larger_than_where_robots_meet() -> None:
    chosen = WiClosureFilter()
    shared, gate = shared_by(chosen, seed=1), make_gate(chosen.settings.gate)
    estimate = shared.estimates["b", "c"]
    ((whole,), (part,)) = estimate.models("b", "c"), estimate.models("b", "c", gate)
    assert part.table.size < whole.table.size
    assert not estimate.models("a", "e", gate)
