from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.types import Trajectory, WirelessLog
from wiclosure.wiclosure_filter.filter import WiClosureFilter


def line(n: int = 11) -> Trajectory:
    """One metre a second along x; turns at a constant rate."""
    positions = np.stack([np.arange(n), np.zeros(n), np.zeros(n)], axis=1).astype(float)
    return Trajectory("alpha", np.arange(n) * 10**9, se3.from_yaw(0.1 * np.arange(n), positions))


def test_poses_between_stamps() -> None:
    at = line().at(np.array([2_500_000_000]))
    np.testing.assert_allclose(at[0, :3, 3], [2.5, 0, 0])
    assert se3.yaw(at)[0] == pytest.approx(0.25)


def test_stamps_since_1970_keep_their_nanoseconds() -> None:
    start = 1_700_000_000_123_456_789
    moving = Trajectory(
        "alpha", start + np.array([0, 1000]), np.stack([np.eye(4), se3.exp(np.array([0, 0, 0, 1.0, 0, 0]))])
    )
    np.testing.assert_allclose(moving.at(np.array([start + 250]))[0, 0, 3], 0.25)


def test_keyframes_know_the_poses_between() -> None:
    """A robot that stands still has a pose there although it makes no keyframe."""
    odometry = line()
    keyframes = odometry.keyframes(np.array([0, 4]))
    np.testing.assert_allclose(keyframes.at(odometry.stamps_ns), odometry.poses, atol=1e-12)
    assert keyframes.covers(odometry.stamps_ns).all()
    assert len(keyframes) == 2
    assert keyframes.nearest(odometry.stamps_ns).tolist() == [0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1]
    T = se3.exp(np.array([0.1, 0.2, 0.3, 4.0, 5.0, 6.0]))
    np.testing.assert_allclose(keyframes.moved(T).at(odometry.stamps_ns), T @ odometry.poses, atol=1e-12)
    np.testing.assert_allclose(keyframes.keyframes(np.array([1])).at(odometry.stamps_ns), odometry.poses, atol=1e-12)


@pytest.mark.parametrize("finer", [True, False])
def test_update_keeps_the_poses_between(finer: bool) -> None:
    odometry = line()
    keyframes = odometry.keyframes(np.array([0, 4, 8]))
    parts = [keyframes.keyframes(np.array([0, 1])), keyframes.keyframes(np.array([2]))]
    if not finer:
        parts = [Trajectory(p.robot, p.stamps_ns, p.poses) for p in parts]
    other = Trajectory("beta", odometry.stamps_ns, odometry.poses)
    incremental = WiClosureFilter()
    incremental.update({"alpha": parts[0], "beta": other}, WirelessLog())
    incremental.update({"alpha": parts[1]}, WirelessLog())
    whole = incremental._trajectories["alpha"]
    np.testing.assert_allclose(whole.poses, keyframes.poses)
    if finer:
        np.testing.assert_allclose(whole.at(odometry.stamps_ns), odometry.poses, atol=1e-12)


def test_nearest_pose() -> None:
    assert line().nearest(np.array([-5, 2_400_000_000, 2_600_000_000, 99 * 10**9])).tolist() == [0, 2, 3, 10]
    assert line(1).nearest(np.array([-5, 5])).tolist() == [0, 0]


POSES = np.tile(np.eye(4), (3, 1, 1))
SECOND = 10**9
STAMPS_NS = [0, SECOND, 2 * SECOND]


def spoilt(entry: object, values: object) -> np.ndarray:
    poses = POSES.copy()
    poses[(1, *entry)] = values  # type: ignore[misc]  # an index of any form
    return poses


@pytest.mark.parametrize(
    ("stamps", "poses", "message"),
    [
        ([0.5, 1.5, 2.5], POSES, r"trajectory of alpha: stamps are floats, the first 0.5; give integer nanoseconds"),
        (np.array([1.7e18, 1.8e18, 1.9e18]), POSES, r"stamps are floats"),
        ([1_700_000_000, 1_700_000_001, 1_700_000_002], POSES, r"a pose every 1 ns; .* multiply seconds by 10\*\*9"),
        (["0", "1", "2"], POSES, r"stamps: expected integers, got a list"),
        ([0, 2 * SECOND, SECOND], POSES, r"the stamp of pose 2 does not follow that of pose 1"),
        (STAMPS_NS, spoilt((slice(3), slice(3)), 2 * np.eye(3)), r"rotation of pose 1 is scaled by 2;"),
        (
            [0, SECOND, 2 * SECOND],
            spoilt((slice(3), slice(3)), np.zeros((3, 3))),
            r"rotation of pose 1 is scaled by 0;",
        ),
        (STAMPS_NS, spoilt((0, 1), 0.1), r"rotation of pose 1 has columns that are not orthonormal"),
        (STAMPS_NS, spoilt((2, 2), -1.0), r"rotation of pose 1 is mirrored"),
        (STAMPS_NS, spoilt((3, 3), 2.0), r"last row of pose 1 is \[0.0, 0.0, 0.0, 2.0\]"),
        (STAMPS_NS, spoilt((3,), [1, 2, 3, 1]), r"last row of pose 1"),  # transposed
        (STAMPS_NS, spoilt((0, 3), np.inf), r"pose 1 is not finite"),
        (STAMPS_NS, POSES[:, :3], r"poses have shape \(3, 3, 4\); expected \(N, 4, 4\)"),
        (STAMPS_NS, np.full((3, 4, 4), "x"), r"poses: expected an array of numbers, got a ndarray"),
        ([0, SECOND], [np.eye(4), np.eye(3)], r"poses: expected an array of numbers, got a list"),
    ],
)
def test_what_is_no_trajectory_is_told_by_name_and_value(stamps: object, poses: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Trajectory("alpha", stamps, poses)  # type: ignore[arg-type]  # lists, and worse


def test_the_robot_comes_first() -> None:
    with pytest.raises(InputError, match="begins with the robot's name"):
        Trajectory(np.arange(3) * SECOND, POSES, "alpha")  # type: ignore[arg-type]


def test_lists_and_other_numbers_are_converted() -> None:
    made = Trajectory("alpha", [0, SECOND], np.tile(np.eye(4, dtype=np.float32), (2, 1, 1)).tolist())  # type: ignore[arg-type]
    assert (made.stamps_ns.dtype, made.poses.dtype) == (np.int64, np.float64)
    assert Trajectory("alpha", np.array([0, SECOND], np.uint64), POSES[:2]).stamps_ns.dtype == np.int64  # type: ignore[arg-type]


def test_rotations_of_few_digits_are_rotations() -> None:
    poses = se3.from_yaw(np.linspace(0, 6, 50), np.zeros((50, 3))).round(4)
    assert len(Trajectory("alpha", np.arange(50) * SECOND, poses)) == 50
    assert len(Trajectory("alpha", np.arange(50) * SECOND, poses.astype(np.float32))) == 50  # type: ignore[arg-type]


def test_simulated_stamps_may_start_at_zero_and_follow_fast() -> None:
    assert len(Trajectory("alpha", np.arange(3) * 1_000_000, POSES)) == 3
    assert len(Trajectory("alpha", np.array([5]), POSES[:1])) == 1


def test_a_trajectory_shows_in_one_short_line() -> None:
    assert repr(line()) == "Trajectory('alpha', 11 poses, 10.0 s, 10.0 m)"


def test_a_trajectory_under_another_robots_name_is_refused() -> None:
    with pytest.raises(InputError, match="the trajectory under 'beta' is of robot 'alpha'"):
        WiClosureFilter().candidates({"beta": line()}, WirelessLog())


@pytest.mark.parametrize(
    ("stamps", "poses", "message"),
    [
        ([0, 0], np.tile(np.eye(4), (2, 1, 1)), "pose 1 does not follow"),
        ([0, 1], np.tile(np.eye(4), (3, 1, 1)), "3 poses"),
        ([], np.zeros((0, 4, 4)), "alpha"),
        ([0, 1], np.full((2, 4, 4), np.nan), "pose 0 is not finite"),
    ],
)
def test_bad_trajectories(stamps: list[int], poses: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Trajectory("alpha", np.array(stamps, np.int64), poses)


def test_stated_step_covariances_compose_over_any_span_and_survive_thinning() -> None:
    rng = np.random.default_rng(0)
    roots = rng.normal(0, 0.01, (10, 6, 6))
    steps = roots @ np.swapaxes(roots, 1, 2)
    stated = Trajectory("alpha", line().stamps_ns, line().poses, step_covariances=steps)
    i, j = np.array([3]), np.array([6])
    expected = steps[3]
    for k in (4, 5):
        expected = se3.compose_covariance(expected, stated.relative_pose(np.array([k]), np.array([k + 1]))[0], steps[k])
    np.testing.assert_allclose(stated.relative_covariance(i, j)[0], expected, rtol=1e-9, atol=1e-15)
    thinned = stated.subset(np.array([0, 3, 6, 10])).moved(se3.from_yaw(1.0, np.array([50.0, -20.0, 3.0])))
    np.testing.assert_allclose(thinned.relative_covariance(i // 3, j // 3)[0], expected, rtol=1e-9, atol=1e-12)
    backwards = stated.relative_covariance(j, i)[0]
    np.testing.assert_allclose(backwards, se3.inverse_covariance(stated.relative_pose(i, j)[0], expected), atol=1e-12)


def test_step_covariances_of_another_length_are_refused() -> None:
    with pytest.raises(InputError, match=r"11 poses but step covariances of shape \(11, 6, 6\)"):
        Trajectory("alpha", line().stamps_ns, line().poses, step_covariances=np.zeros((11, 6, 6)))


def branching(seed=0, n=40):
    """Odometry whose steps start from any earlier pose, and the covariance of each step."""
    rng = np.random.default_rng(seed)
    parents = np.array([0, *(int(rng.integers(max(0, k - 3), k)) for k in range(1, n))])
    steps = se3.exp(rng.normal(size=(n, 6)) * 0.3)
    poses = [np.eye(4)]
    for k in range(1, n):
        poses.append(poses[parents[k]] @ steps[k])
    factors = rng.normal(size=(n - 1, 6, 6)) * 0.01
    covariances = factors @ np.swapaxes(factors, 1, 2)
    stamps = np.arange(n, dtype=np.int64) * 1_000_000_000
    return Trajectory("a", stamps, np.stack(poses), step_covariances=covariances, parents=parents)


def way(trajectory, i, j):
    """Covariance of `T_i_j`, step by step up to the common pose and down again."""

    def line(k):
        return [k, *line(trajectory.parents[k])] if k else [0]

    steps = set(line(i)) ^ set(line(j))
    Ad = se3.adjoint(se3.inverse(trajectory.poses[j]) @ trajectory.poses)
    return sum((Ad[k] @ trajectory.step_covariances[k - 1] @ Ad[k].T for k in steps), np.zeros((6, 6)))


def test_where_odometry_branches_covariances_follow_its_steps():
    trajectory, pairs = branching(), np.random.default_rng(1).integers(0, 40, (60, 2))
    found = trajectory.relative_covariance(*pairs.T)
    np.testing.assert_allclose(found, [way(trajectory, i, j) for i, j in pairs], atol=1e-12)
    traces = trajectory.rotation_variance_between(*pairs.T)
    np.testing.assert_allclose(traces, np.trace(trajectory.drift_between(*pairs.T)[:, :3, :3], axis1=1, axis2=2))


def test_a_subset_with_the_forks_keeps_the_odometry_of_a_branching_trajectory():
    trajectory = branching(3)
    kept = np.unique([0, 7, 11, 25, 38, *trajectory.junctions])
    subset = trajectory.subset(kept)
    i, j = np.random.default_rng(2).integers(0, len(kept), (2, 50))
    expected = trajectory.relative_covariance(kept[i], kept[j])
    np.testing.assert_allclose(subset.relative_covariance(i, j), expected, atol=1e-12)
    assert trajectory.junctions.tolist() == [k for k in range(40) if (trajectory.parents[1:] == k).sum() > 1]


def test_a_chain_given_by_parents_is_the_chain():
    chain = replace(branching(), parents=np.maximum(np.arange(40) - 1, 0))
    i, j = np.random.default_rng(2).integers(0, 40, (2, 50))
    expected = replace(chain, parents=None).relative_covariance(i, j)
    np.testing.assert_allclose(chain.relative_covariance(i, j), expected, atol=1e-12)


@pytest.mark.parametrize("parents", [[0, 1, 1], [0, 0], [0, 0, -1], [1, 0, 0]])
def test_parents_are_earlier_poses(parents):
    with pytest.raises(InputError, match="earlier poses"):
        Trajectory(
            "a",
            np.arange(3),
            np.stack([np.eye(4)] * 3),
            step_covariances=np.zeros((2, 6, 6)),
            parents=np.array(parents),
        )


@pytest.mark.parametrize("stated", [False, True])
def test_a_step_that_is_loosened_is_so_in_all_spans_across_it_and_in_no_other(stated: bool) -> None:
    path = line()
    path = replace(path, step_covariances=np.tile(0.01 * np.eye(6), (10, 1, 1))) if stated else path
    loosened = path.loosened_step(4, 9.0 * np.eye(6))
    variance = [
        loosened.translation_variance_between(np.array([i]), np.array([j]))[0] for i, j in ((0, 3), (3, 4), (4, 10))
    ]
    assert variance[0] < 3.0
    assert variance[1] == pytest.approx(27.0, rel=0.05)
    assert variance[2] < 3.0
    np.testing.assert_array_equal(loosened.poses, path.poses)
