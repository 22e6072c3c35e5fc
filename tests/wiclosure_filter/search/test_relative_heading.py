"""Where the position is ambiguous, compasses still tell how the robots are turned."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import (
    AlignmentHypothesis,
    FrameAlignment,
    Heading,
    PredictionKind,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.search.relative_heading import RelativeHeading, compass_yaw

YAW = 0.7


def road(robot: str, seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    yaw = np.cumsum(rng.normal(0, 0.2, 40))
    steps = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(40)], axis=1)
    poses = se3.from_yaw(yaw, np.cumsum(steps, axis=0))
    return Trajectory(robot, np.arange(40, dtype=np.int64) * 10**9, poses).moved(se3.inverse(poses[0]))


TEAM = {"alpha": road("alpha", 1), "beta": road("beta", 2)}


def ambiguous(other_yaw: float | None, knowledge: str = "heading") -> FrameAlignment:
    best = AlignmentHypothesis(se3.from_yaw(YAW, np.array([5.0, 0.0, 0.0])), 0.0, ())
    other = None
    if other_yaw is not None:
        other = AlignmentHypothesis(se3.from_yaw(other_yaw, np.array([-6.0, 0.0, 0.0])), -1.0, ())
    return FrameAlignment("alpha", "beta", best, np.eye(6) * 0.05**2, True, "two answers", other, knowledge)


def test_rotations_follow_the_compasses_and_positions_stay_open() -> None:
    yaw = compass_yaw(ambiguous(YAW + 0.02), 0.35)
    assert yaw is not None
    assert yaw == pytest.approx((YAW, np.hypot(0.05, 0.02)))
    heading = RelativeHeading(TEAM, *yaw, tilt_sigma_rad=0.07, sensor_range_m=35.0, height_sigma_m=10.0)
    assert heading.kind is PredictionKind.HEADING
    i, j = (grid.ravel() for grid in np.indices((40, 40)))
    T_a_b, covariance = heading.relative_poses("alpha", i, "beta", j)
    turned = se3.from_yaw(YAW, np.zeros(3)) @ TEAM["beta"].poses[j]
    expected = se3.between(TEAM["alpha"].poses[i], turned)
    np.testing.assert_allclose(T_a_b[:, :3, :3], expected[:, :3, :3], atol=1e-9)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    assert (np.sqrt(covariance[:, 2, 2]) < 0.2).all()
    assert (np.sqrt(covariance[:, 3, 3]) >= 17.5).all()


@pytest.mark.parametrize(
    ("alignment", "why"),
    [
        (ambiguous(YAW + np.pi), "a other is turned the other way"),
        (ambiguous(None, "one-way"), "no compass"),
        (FrameAlignment("alpha", "beta", None, None, True, "nothing agrees", None, "heading"), "no alignment"),
    ],
)
def test_nothing_is_told_where_the_heading_is_open(alignment: FrameAlignment, why: str) -> None:
    assert compass_yaw(alignment, 0.35) is None, why


@pytest.mark.parametrize("compasses", [True, False])
def test_an_ambiguous_pair_is_kept_whole_and_with_what_compasses_tell(compasses: bool) -> None:
    """Two ranges fix no position, and two headings fix the turn."""
    ranges = tuple(WirelessMeasurement(k * 10**9, "alpha", "beta", 10.0, 0.3) for k in (0, 30))
    headings = tuple(
        Heading(int(t.stamps_ns[k]), name, float(se3.yaw(t.poses[k])) + (YAW if name == "beta" else 0.0), 0.05)
        for name, t in TEAM.items()
        for k in range(0, 40, 5)
    )
    result = WiClosureFilter().candidates(TEAM, WirelessLog(ranges, headings if compasses else ()))
    assert result.alignments[0].ambiguous
    assert result.pairs_kept == result.pairs_total
    predicted = result.pairs[0].predicted(np.array([0]))
    if not compasses:
        assert predicted is None
        return
    assert predicted is not None
    assert abs(float(se3.yaw(predicted[0][0])) - YAW) < 0.1
    assert any("relative heading" in sentence for sentence in result.diagnosis)
