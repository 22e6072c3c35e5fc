"""A team's run made of nouns, without any stage: every fate a closure can have, certain and ambiguous alignments.

Robots drive half a circle each, the next one a little further on; the last can be left unconnected.  The benchmark of
the report takes its large team from here.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import gtsam
import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.estimate.graph_result import GraphResult
from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.colours import ROBOT_COLOURS
from wiclosure.frontends.front_end_result import FrontEndCounts, FrontEndResult
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.inputs import Inputs, RobotInput
from wiclosure.pipeline.evaluation.evaluate import Findings, evaluate
from wiclosure.pipeline.stages.run_result import RunResult, Solution
from wiclosure.types import (
    AlignmentHypothesis,
    AoaPath,
    CandidatePairs,
    Closure,
    FilterResult,
    FrameAlignment,
    KeyframeId,
    Measured,
    RegistrationEvidence,
    Residual,
    ScanContextMatch,
    Stage,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)

REASONS = {
    Stage.REGISTRATION: "only 0.{:02d} of the structure matches, 0.40 needed",
    Stage.RADIO_CHECK: "contradicts the radio: 10^{:d} to 1 that the robots' frames lie otherwise",
    Stage.CONSISTENCY: "inconsistent with the {:d} closures of the largest consistent set",
    Stage.ESTIMATE: "contradicts the joint estimate, {:d} m off it",
}
SECOND_NS = 10**9


def made_run(
    robots: Sequence[str] = ("alpha", "beta"),
    *,
    keyframes: int = 40,
    closures: int = 8,
    measurements: int = 30,
    map_points: int = 2_000,
    cloud_points: int = 300,
    lost: bool = False,
) -> RunResult:
    """A run that no stage made.

    Args:
        robots: names.
        keyframes: of each robot, one metre and one second apart.
        closures: accepted ones between each robot and the next; half as many are rejected, at each stage in turn.
        measurements: of each robot and the next.
        map_points: of the merged map.
        cloud_points: of each keyframe's scan.
        lost: whether the last robot is not connected, and its alignment with the one before ambiguous.
    """
    rng = np.random.default_rng(0)
    config = Config()
    truth = {robot: _half_circle(robot, n, keyframes) for n, robot in enumerate(robots)}
    own = {robot: path.moved(se3.inverse(path.poses[0])) for robot, path in truth.items()}
    joined = robots[:-1] if lost else robots
    merged = {robot: truth[robot] if robot in joined else own[robot] for robot in robots}
    found = [
        closure
        for a, b in itertools.pairwise(robots)
        for closure in _closures(truth[a], truth[b], 0 if lost and b == robots[-1] else closures, closures // 2)
    ]
    wireless = _wireless(truth, measurements)
    filtered = FilterResult(
        "wiclosure",
        tuple(_pairs(truth[a], truth[b]) for n, a in enumerate(robots) for b in robots[n + 1 :]),
        pairs_total=keyframes**2 * len(robots) * (len(robots) - 1) // 2,
        alignments=tuple(
            _alignment(truth[a], truth[b], wireless, ambiguous=lost and b == robots[-1])
            for a, b in itertools.pairwise(robots)
        ),
        seconds=0.5,
    )
    components = (tuple(joined), *(((robots[-1],),) if lost else ()))
    identity = {robot: np.eye(4) for robot in robots}
    graph = GraphResult(merged, identity, components, tuple(found), (), gtsam.NonlinearFactorGraph(), gtsam.Values())
    seconds = {"filter": 0.5, "matching": 0.25, "verification": 3.0, "optimisation": 0.25}
    solution = Solution(filtered, (), tuple(found), graph, seconds, seconds, 1_500_000, ())
    costs = {
        "seconds": {"odometry": 6.0, **seconds, "total": 10.0},
        "seconds_spent": {"odometry": 6.0, **seconds, "total": 10.0},
        "bytes_exchanged": 1_500_000,
        "peak_rss_mb": 300.0,
    }
    findings = Findings(filtered, found, components, own, own, merged)
    metrics = evaluate(findings, truth, config.evaluation, costs=costs, diagnosis=["made up"])
    fronts = {robot: _front(path, rng, cloud_points) for robot, path in own.items()}
    inputs = Inputs(tuple(RobotInput(robot, [], None, path) for robot, path in truth.items()), wireless)
    return RunResult(config, inputs, fronts, solution, merged, _map(rng, merged, joined, map_points), metrics)


def _half_circle(robot: str, number: int, keyframes: int) -> Trajectory:
    radius_m = keyframes / np.pi
    angle = np.linspace(0.0, np.pi, keyframes) + 0.5 * number
    places = np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle), np.full(keyframes, 0.1 * number)])
    poses = np.stack([se3.from_yaw(float(a) + np.pi / 2, place) for a, place in zip(angle, places, strict=True)])
    return Trajectory(robot, SECOND_NS * np.arange(1, keyframes + 1), poses)


def _closures(a: Trajectory, b: Trajectory, accepted: int, rejected: int) -> list[Closure]:
    """True ones where both passed the same place; rejected ones are turned around and 5 m off."""
    ahead = round(0.5 / np.pi * len(a))
    stages = list(REASONS)
    found = []
    for n in range(accepted + rejected):
        k = (n * 7) % (len(a) - ahead)
        query, match = KeyframeId(a.robot, k + ahead), KeyframeId(b.robot, k)
        closure = Closure(query, match, scan_context=ScanContextMatch(0.1, 0.0), overlap_probability=0.9)
        T_query_match = se3.between(a.poses[query.index], b.poses[match.index])
        evidence = RegistrationEvidence(900, 0.8, 0.97, 0.05, 1.5 if n % 2 else None)
        if n < accepted:
            measured = closure.measured_as(Measured(T_query_match, 1e-4 * np.eye(6), evidence))
            reason = f"one of {accepted} closures that agree"
            found.append(_with_residual(measured.accepted(Stage.ESTIMATE, reason)))
            continue
        stage = stages[(n - accepted) % len(stages)]
        if stage is not Stage.REGISTRATION or n % 3:
            wrong = T_query_match @ se3.from_yaw(np.pi, np.array([5.0, 0.0, 0.0]))
            closure = closure.measured_as(Measured(wrong, 1e-4 * np.eye(6), evidence))
        found.append(closure.rejected(stage, REASONS[stage].format(n)))
    return found


def _with_residual(closure: Closure) -> Closure:
    from dataclasses import replace

    return replace(closure, consistent_with=3, residual=Residual(0.02, 0.001))


def _wireless(truth: dict[str, Trajectory], measurements: int) -> WirelessLog:
    """Each robot hears the next: exact ranges and directions, and one reflection each."""
    robots = list(truth)
    log = []
    for a, b in itertools.pairwise(robots):
        keyframes = len(truth[a])
        for n in range(measurements):
            k = n * keyframes // measurements
            seen = se3.between(truth[a].poses[k], truth[b].poses[k])[:3, 3]
            azimuth = float(np.arctan2(seen[1], seen[0]))
            log.append(
                WirelessMeasurement(
                    int(truth[a].stamps_ns[k]) + n % (keyframes // measurements or 1),
                    receiver=a,
                    transmitter=b,
                    range_m=float(np.linalg.norm(seen)),
                    range_sigma_m=0.1,
                    paths=(AoaPath(azimuth, 0.1, 0.6), AoaPath(float(np.sin(n)), 0.1, 0.4)),
                )
            )
    return WirelessLog(measurements=tuple(log))


def _alignment(a: Trajectory, b: Trajectory, log: WirelessLog, *, ambiguous: bool) -> FrameAlignment:
    T_a_b = se3.between(a.poses[0], b.poses[0])
    rows = [row for row, m in enumerate(log.measurements) if (m.receiver, m.transmitter) == (a.robot, b.robot)]
    best = AlignmentHypothesis(T_a_b, -10.0, tuple((row, 0) for row in rows))
    other = AlignmentHypothesis(T_a_b @ se3.from_yaw(np.pi / 2, np.array([3.0, 4.0, 0.0])), -10.0 - np.log(4.0), ())
    reason = (
        "an alignment 5.0 m away is nearly as likely (odds 4.0 to 1)"
        if ambiguous
        else f"{len(rows)} bearings and {len(rows)} ranges of {len(rows)} measurements agree"
    )
    sigma = np.array([0.01, 0.01, 0.02, 0.3, 0.4, 0.5])
    likely_alternatives = (other,) if ambiguous else ()
    return FrameAlignment(
        a.robot, b.robot, best, np.diag(sigma**2), ambiguous, reason, likely_alternatives=likely_alternatives
    )


def _pairs(a: Trajectory, b: Trajectory) -> CandidatePairs:
    """Those of which both passed within 8 m."""
    from scipy.spatial import cKDTree

    near = cKDTree(a.positions).sparse_distance_matrix(cKDTree(b.positions), 8.0, output_type="coo_matrix")
    order = np.lexsort([near.col, near.row])
    return CandidatePairs.without_prediction(
        a.robot, b.robot, near.row[order].astype(np.int64), near.col[order].astype(np.int64)
    )


def _front(path: Trajectory, rng: np.random.Generator, cloud_points: int) -> FrontEndResult:
    clouds = tuple(
        rng.uniform([-20, -20, -2], [20, 20, 4], (cloud_points, 3)).astype(np.float32) for _ in range(len(path))
    )
    return FrontEndResult(
        robot=path.robot,
        odometry=path,
        scans=path,
        keyframe_indices=np.arange(len(path)),
        keyframes=path,
        clouds=clouds,
        descriptors=np.zeros((len(path), 2, 3), np.float32),
        counts=FrontEndCounts(len(path)),
        seconds_reading=0.0,
        seconds_odometry=3.0,
        seconds_descriptors=0.1,
    )


def _map(rng: np.random.Generator, merged: dict[str, Trajectory], joined: Sequence[str], map_points: int) -> MergedMap:
    """Ground and walls around the robots' paths."""
    robot = rng.integers(0, len(joined), map_points)
    at = np.stack([merged[name].positions for name in joined])[
        robot, rng.integers(0, len(merged[joined[0]]), map_points)
    ]
    points = at + rng.normal(0, [8, 8, 0.05], (map_points, 3))
    points[::2, 2] += rng.uniform(0, 5, len(points[::2]))
    intensity = (100 + 50 * np.sin(points[:, 0])).astype(np.float32)
    return MergedMap(points.astype(np.float32), ROBOT_COLOURS[robot % len(ROBOT_COLOURS)], intensity)


@pytest.fixture(scope="session")
def run_of() -> Callable[..., RunResult]:
    """See `made_run`."""
    return made_run


@pytest.fixture(scope="session")
def lost_run() -> RunResult:
    """Three robots, of which the last is not connected and its alignment is ambiguous."""
    return made_run(("alpha", "beta", "gamma"), lost=True)
