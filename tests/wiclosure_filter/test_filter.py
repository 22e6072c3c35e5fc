"""The whole filter: from odometry and radio to pairs, and what it says where the radio does not tell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.pipeline.config import load_config
from wiclosure.pipeline.runtime.cluster.connection import cluster
from wiclosure.pipeline.runtime.processes import Processes
from wiclosure.types import AoaPath, FilterResult, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter import side_by_side
from wiclosure.wiclosure_filter.config import FilterSettings, GateSettings, SharedTrajectorySettings
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.workers import Workers

RADIUS_M = 35.0


def loop(robot: str, start_s: float, length_m: float, turn: float) -> Trajectory:
    """A drive round a block of 200 m by 120 m, beginning somewhere along it; 10 m/s, a keyframe every 2 m."""
    corners = np.array([[0, 0], [200, 0], [200, 120], [0, 120], [0, 0]], float)
    sides = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    at = np.mod(start_s + np.arange(0, length_m, 2.0) * turn, sides.sum())
    position = np.stack([np.interp(at, np.concatenate([[0], np.cumsum(sides)]), corners[:, i]) for i in (0, 1)], 1)
    ahead = np.gradient(position, axis=0)
    poses = se3.from_yaw(np.arctan2(ahead[:, 1], ahead[:, 0]), np.pad(position, ((0, 0), (0, 1))))
    return Trajectory(robot, np.arange(len(poses), dtype=np.int64) * 200_000_000, poses)


def town() -> dict[str, Trajectory]:
    return {
        "alpha": loop("alpha", 0.0, 640.0, 1.0),
        "beta": loop("beta", 200.0, 640.0, -1.0),
        "gamma": loop("gamma", 400.0, 300.0, 1.0),
    }


def odometry_of(truth: dict[str, Trajectory], seed: int = 0) -> dict[str, Trajectory]:
    """Each in its own frame, with a little drift."""
    rng = np.random.default_rng(seed)
    result = {}
    for name, t in truth.items():
        steps = se3.between(t.poses[:-1], t.poses[1:])
        noise = rng.normal(size=(len(steps), 6)) * np.array([0, 0, 0.0008, 0.05, 0.05, 0.0])
        poses = [np.eye(4)]
        for step in steps @ se3.exp(noise):
            poses.append(poses[-1] @ step)
        result[name] = Trajectory(name, t.stamps_ns, np.array(poses))
    return result


def hear(truth: dict[str, Trajectory], pairs: list[tuple[str, str]], seed: int = 1) -> WirelessLog:
    """Range, the direct path in most, and three false ones; a measurement every 10 m."""
    rng = np.random.default_rng(seed)
    heard = []
    for receiver, transmitter in pairs:
        for index in range(0, min(len(truth[receiver]), len(truth[transmitter])), 5):
            seen = se3.between(truth[receiver].poses[index], truth[transmitter].poses[index])[:3, 3]
            azimuths = [*rng.uniform(-np.pi, np.pi, 3)]
            if rng.uniform() < 0.85:
                azimuths.append(np.arctan2(seen[1], seen[0]) + rng.normal(0, 0.17))
            heard.append(
                WirelessMeasurement(
                    int(truth[receiver].stamps_ns[index]),
                    receiver,
                    transmitter,
                    range_m=abs(float(np.linalg.norm(seen) + rng.normal(0, 0.5))),
                    range_sigma_m=0.5,
                    paths=tuple(AoaPath(float(a), 0.17) for a in azimuths),
                )
            )
    return WirelessLog(tuple(sorted(heard, key=lambda m: m.stamp_ns)))


def recall_and_precision(result: FilterResult, truth: dict[str, Trajectory]) -> tuple[float, float]:
    near_kept = near = kept = 0
    for pairs in result.pairs:
        a, b = truth[pairs.robot_a].positions, truth[pairs.robot_b].positions
        true = np.linalg.norm(a[:, None] - b[None], axis=2) <= RADIUS_M
        near, kept = near + int(true.sum()), kept + len(pairs)
        near_kept += int(true[pairs.index_a, pairs.index_b].sum())
    return near_kept / near, near_kept / kept


@pytest.fixture(scope="module")
def truth() -> dict[str, Trajectory]:
    return town()


@pytest.fixture(scope="module")
def odometry(truth: dict[str, Trajectory]) -> dict[str, Trajectory]:
    return odometry_of(truth)


@pytest.fixture(scope="module")
def wireless(truth: dict[str, Trajectory]) -> WirelessLog:
    return hear(truth, [("alpha", "beta"), ("beta", "gamma")])


@pytest.fixture(scope="module")
def result(odometry: dict[str, Trajectory], wireless: WirelessLog) -> FilterResult:
    return WiClosureFilter().candidates(odometry, wireless)


def test_keeps_the_near_pairs_and_few_others(result: FilterResult, truth: dict[str, Trajectory]) -> None:
    recall, precision = recall_and_precision(result, truth)
    assert recall >= 0.99
    assert precision >= 0.7
    assert result.pairs_kept < 0.4 * result.pairs_total


def test_robots_that_never_met_are_pruned_through_the_third(result: FilterResult) -> None:
    by_pair = {(p.robot_a, p.robot_b): p for p in result.pairs}
    assert by_pair["alpha", "gamma"].predictor is not None
    assert {(a.robot_a, a.robot_b) for a in result.alignments} == {("alpha", "beta"), ("beta", "gamma")}


def test_kept_pairs_carry_a_prediction(result: FilterResult, truth: dict[str, Trajectory]) -> None:
    for pairs in result.pairs:
        rows = np.arange(0, len(pairs), 7)
        predicted = pairs.predicted(rows)
        assert predicted is not None
        T, C = predicted
        true = se3.between(
            truth[pairs.robot_a].poses[pairs.index_a[rows]], truth[pairs.robot_b].poses[pairs.index_b[rows]]
        )
        # As errors in frame b, where the covariance lives; z is not moved in this town.
        error = se3.log(se3.between(T, true))[:, [2, 3, 4]]
        sigma = np.sqrt(np.einsum("mii->mi", C))[:, [2, 3, 4]]
        assert np.median(np.abs(error) / sigma) < 1.5
        assert (pairs.overlap_probability >= 0.05).all()


def test_links_for_the_pose_graph_hold_at_the_true_poses(result: FilterResult, truth: dict[str, Trajectory]) -> None:
    assert {(of.robot_a, of.robot_b) for of in result.links} == {("alpha", "beta"), ("beta", "gamma")}
    for of in result.links:
        T_world_a, T_world_b = truth[of.robot_a].poses[of.index_a], truth[of.robot_b].poses[of.index_b]
        a, b = se3.transform(T_world_a, of.antenna_a), se3.transform(T_world_b, of.antenna_b)
        distance = np.linalg.norm(b - a, axis=1)
        assert np.nanmedian(np.abs(distance - of.range_m) / of.range_sigma_m) < 1.0
        receiver = np.where(of.a_receives[:, None, None], T_world_a, T_world_b)[:, :3, :3]
        seen = np.einsum("lji,lj->li", receiver, np.where(of.a_receives[:, None], b - a, a - b))
        along = np.einsum("li,li->l", seen, of.direction) / np.maximum(distance, 1e-9)  # two of them meet
        off = np.arccos(np.clip(along, -1.0, 1.0))
        assert np.nanmedian(off) < 0.17
        assert np.isfinite(of.direction).all(axis=1).mean() > 0.5


def test_same_input_same_pairs(result: FilterResult, odometry: dict[str, Trajectory], wireless: WirelessLog) -> None:
    again = WiClosureFilter().candidates(odometry, wireless)
    for one, two in zip(result.pairs, again.pairs, strict=True):
        np.testing.assert_array_equal(one.index_a, two.index_a)
        np.testing.assert_array_equal(one.index_b, two.index_b)
        np.testing.assert_array_equal(one.overlap_probability, two.overlap_probability)


def test_updates_end_where_a_batch_run_ends(
    result: FilterResult, odometry: dict[str, Trajectory], wireless: WirelessLog
) -> None:
    growing = WiClosureFilter()
    for first, last in ((0, 100), (100, 250), (250, 400)):
        keyframes, until = {}, 0
        for name, t in odometry.items():
            rows = np.arange(first, min(last, len(t)))
            if len(rows):
                keyframes[name] = t.subset(rows)
                until = max(until, int(keyframes[name].stamps_ns[-1]))
        since = 0 if first == 0 else first * 200_000_000
        new = tuple(m for m in wireless.measurements if since <= m.stamp_ns < last * 200_000_000)
        updated = growing.update(keyframes, WirelessLog(new))
    assert updated.pairs_total == result.pairs_total
    for one, two in zip(result.pairs, updated.pairs, strict=True):
        np.testing.assert_array_equal(one.index_a, two.index_a)
        np.testing.assert_array_equal(one.index_b, two.index_b)
        np.testing.assert_array_equal(one.mahalanobis, two.mahalanobis)
    with pytest.raises(InputError, match="does not follow"):
        growing.update({"alpha": odometry["alpha"]}, WirelessLog())


def test_budget_keeps_the_most_probable(odometry: dict[str, Trajectory], wireless: WirelessLog) -> None:
    few = WiClosureFilter(FilterSettings(gate=GateSettings(budget=500))).candidates(odometry, wireless)
    all_kept = WiClosureFilter().candidates(odometry, wireless)
    for best, everything in zip(few.pairs, all_kept.pairs, strict=True):
        assert len(best) == min(500, len(everything))
        left_out = np.sort(everything.overlap_probability)[: -len(best)]
        assert best.overlap_probability.min() >= (left_out.max() if len(left_out) else 0.0)
        assert (np.diff(best.index_a * 10_000 + best.index_b) > 0).all()


def test_the_papers_method_runs(odometry: dict[str, Trajectory], truth: dict[str, Trajectory]) -> None:
    wireless = hear(truth, [("alpha", "beta"), ("beta", "alpha")])
    settings = load_config("paper").filter
    team = {name: odometry[name] for name in ("alpha", "beta")}
    kept = WiClosureFilter(settings).candidates(team, wireless)
    assert kept.alignments[0].best is not None
    assert 0 < kept.pairs_kept <= kept.pairs_total


def test_nothing_heard_keeps_everything_and_says_so(odometry: dict[str, Trajectory]) -> None:
    result = WiClosureFilter().candidates(odometry, WirelessLog())
    assert result.pairs_kept == result.pairs_total
    assert any("no measurement between the robots; every pair is kept" in s for s in result.diagnosis)


@pytest.mark.parametrize("policy", ["pass", "reject", "raise"])
def test_ambiguity_policy(policy: str, truth: dict[str, Trajectory], odometry: dict[str, Trajectory]) -> None:
    """One measurement cannot tell how two frames lie."""
    one = WirelessLog(hear(truth, [("alpha", "beta")]).measurements[:1])
    team = {name: odometry[name] for name in ("alpha", "beta")}
    chosen = WiClosureFilter(FilterSettings(on_ambiguous=policy))
    if policy == "raise":
        with pytest.raises(InputError, match="alpha and beta"):
            chosen.candidates(team, one)
        return
    result = chosen.candidates(team, one)
    assert result.alignments[0].ambiguous
    assert result.pairs_kept == (result.pairs_total if policy == "pass" else 0)
    outcome = {"pass": "every pair is kept", "reject": "every pair is rejected"}[policy]
    assert any("alpha and beta" in s and outcome in s for s in result.diagnosis)


def test_strangers_in_the_log_are_named(odometry: dict[str, Trajectory]) -> None:
    stranger = WirelessMeasurement(0, "alpha", "zeta", range_m=1.0, range_sigma_m=0.1)
    result = WiClosureFilter().candidates(odometry, WirelessLog((stranger,)))
    assert any("zeta" in s and "no trajectory" in s for s in result.diagnosis)


def test_measurements_outside_the_time_are_counted(odometry: dict[str, Trajectory]) -> None:
    late = tuple(WirelessMeasurement(10**15 + i, "alpha", "beta", range_m=5.0, range_sigma_m=0.5) for i in range(3))
    result = WiClosureFilter().candidates(odometry, WirelessLog(late))
    assert any("3 of 3 measurements lie outside" in s for s in result.diagnosis)
    assert result.pairs_kept == result.pairs_total


@pytest.mark.parametrize("size", [1, 2])
def test_tiny_trajectories(size: int) -> None:
    team = {name: Trajectory(name, np.arange(size) * 10**9, np.tile(np.eye(4), (size, 1, 1))) for name in "ab"}
    heard = WirelessMeasurement(0, "a", "b", range_m=5.0, range_sigma_m=0.5, paths=(AoaPath(0.0, 0.1),))
    result = WiClosureFilter().candidates(team, WirelessLog((heard,) * 3))
    assert result.pairs_total == size**2
    assert result.pairs_kept == size**2


def test_most_links_bounds_the_estimate(
    odometry: dict[str, Trajectory], wireless: WirelessLog, truth: dict[str, Trajectory]
) -> None:
    settings = FilterSettings(shared_trajectory=SharedTrajectorySettings(most_links=30, least_links=10))
    result = WiClosureFilter(settings).candidates(odometry, wireless)
    (sentence,) = [s for s in result.diagnosis if "the joint estimate uses" in s]
    used = int(sentence.split("uses ")[1].split()[0])
    assert 25 <= used <= 30  # of each pair its share, rounded down
    assert recall_and_precision(result, truth)[0] >= 0.98


def test_robots_side_by_side_with_identical_positions() -> None:
    """Antennas that coincide have no direction: the estimate must not break on it."""
    t = loop("alpha", 0.0, 100.0, 1.0)
    team = {"alpha": t, "beta": Trajectory("beta", t.stamps_ns, t.poses)}
    heard = tuple(
        WirelessMeasurement(int(s), "alpha", "beta", range_m=0.0, range_sigma_m=0.5, paths=(AoaPath(0.1, 0.2),))
        for s in t.stamps_ns[::5]
    )
    result = WiClosureFilter().candidates(team, WirelessLog(heard))
    assert 0 < result.pairs_kept <= result.pairs_total


@pytest.fixture(scope="module")
def half_clockwise(odometry: dict[str, Trajectory], wireless: WirelessLog) -> tuple[WirelessLog, FilterResult]:
    """Azimuths of beta are mirrored, those of alpha are not; and what one process makes of it."""
    heard = [
        replace(m, paths=tuple(replace(path, azimuth=-path.azimuth) for path in m.paths)) if m.receiver == "beta" else m
        for m in wireless.measurements
    ]
    spoiled = replace(wireless, measurements=tuple(heard))
    return spoiled, WiClosureFilter().candidates(odometry, spoiled)


@pytest.fixture(params=["processes", pytest.param("dask", marks=pytest.mark.slow)])
def workers(request: pytest.FixtureRequest) -> Iterator[Workers]:
    if request.param == "dask":
        pytest.importorskip("distributed")
        with cluster("local:2") as there:
            yield there
    else:
        yield Processes(2)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_workers_do_as_one_process_does(
    odometry: dict[str, Trajectory],
    half_clockwise: tuple[WirelessLog, FilterResult],
    workers: Workers,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Alignments, diagnoses and searches, to the last bit."""
    wireless, alone = half_clockwise
    monkeypatch.setattr(side_by_side, "_WORTH_WORKERS", 1)
    monkeypatch.setattr(side_by_side, "_AT_ONCE", 1)
    found = WiClosureFilter(workers=workers).candidates(odometry, wireless)
    assert [a.best.T_a_b.tobytes() for a in found.alignments if a.best] == [
        a.best.T_a_b.tobytes() for a in alone.alignments if a.best
    ]
    assert 0 < alone.pairs_kept < alone.pairs_total
    assert alone.diagnosis == found.diagnosis
    assert {(a.robot_a, a.robot_b) for a in alone.alignments if a.suspected_fault} == {("beta", "gamma")}
    for one, other in zip(alone.pairs, found.pairs, strict=True):
        assert (one.robot_a, one.robot_b) == (other.robot_a, other.robot_b)
        for name in ("index_a", "index_b", "overlap_probability", "mahalanobis"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
