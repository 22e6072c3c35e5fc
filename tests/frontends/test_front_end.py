from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.errors import InputError
from wiclosure.frontends.config import KeyframeSettings, OdometrySettings, ScanContextSettings
from wiclosure.frontends.front_end import OdometryRun, describe_all
from wiclosure.frontends.front_end_result import Descriptors, FrontEndResult, OdometryResult
from wiclosure.types import FloatArray, Scan, Trajectory


class Drive(Protocol):
    stamps_ns: FloatArray

    def __len__(self) -> int: ...
    def __getitem__(self, index: int) -> Scan: ...


KEYFRAMES = KeyframeSettings(distance_m=0.5)


def room(T_world_body: FloatArray, seed: int = 0) -> FloatArray:
    """Points of a room of 20 x 14 x 4 m with pillars, in the body's axes."""
    rng = np.random.default_rng(seed)
    walls = rng.uniform([-10, -7, -1], [10, 7, 3], (6000, 3))
    side = rng.integers(0, 5, 6000)
    for axis, edges in ((0, (-10, 10)), (1, (-7, 7))):
        for k, edge in enumerate(edges):
            walls[side == 2 * axis + k, axis] = edge
    walls[side == 4, 2] = -1
    pillar = rng.integers(0, 4, 800)
    pillars = np.array([[4, 3], [-5, 2], [-3, -4], [6, -3]])[pillar] + rng.normal(0, 0.05, (800, 2))
    columns = np.column_stack([pillars, rng.uniform(-1, 3, 800)])
    return se3.transform(se3.inverse(T_world_body), np.concatenate([walls, columns]))


def start(robot: str = "alpha", keyframes: KeyframeSettings = KEYFRAMES) -> OdometryRun:
    return OdometryRun(OdometrySettings(), [keyframes], robot)


def walk(steps: int, drift: DriftModel) -> FrontEndResult:
    run = start()
    for k in range(steps):
        pose = se3.from_yaw(0.02 * k, np.array([0.1 * k, 0.02 * k, 0.0]))
        run.process(Scan(k * 100_000_000, room(pose)))
    (found,) = run.results()
    return FrontEndResult.of("alpha", drift, found, describe_all(found.clouds, ScanContextSettings()))


def test_a_walk_through_a_room_is_followed_and_its_keyframes_are_poses_of_it() -> None:
    result = walk(21, DriftModel())
    assert result.odometry.robot == "alpha"
    np.testing.assert_allclose(result.odometry.positions[-1], [2.0, 0.4, 0.0], atol=0.05)
    assert se3.yaw(result.odometry.poses[-1]) == pytest.approx(0.4, abs=0.01)
    assert result.keyframe_indices.tolist() == [0, 5, 10, 15, 20]
    np.testing.assert_array_equal(result.keyframes.poses, result.odometry.poses[result.keyframe_indices])
    assert len(result.clouds) == len(result.descriptors) == len(result.keyframes)
    assert result.counts.scans == 21


def test_saved_stages_are_read_back_the_same(tmp_path: Path) -> None:
    run = start()
    for k in range(12):
        run.process(Scan(k * 100_000_000, room(se3.from_yaw(0.02 * k, np.array([0.1 * k, 0.02 * k, 0.0])))))
    (saved,) = run.results()
    saved.save(tmp_path / "alpha.cache")
    loaded = OdometryResult.load(tmp_path / "alpha.cache")
    assert (loaded.counts, loaded.seconds) == (saved.counts, saved.seconds)
    for name in ("stamps_ns", "poses", "keyframe_indices"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(saved, name))
    assert len(loaded.clouds) == len(saved.clouds)
    for cloud, expected in zip(loaded.clouds, saved.clouds, strict=True):
        np.testing.assert_array_equal(cloud, expected)
        assert cloud.dtype == np.float32
    described = describe_all(saved.clouds, ScanContextSettings())
    described.save(tmp_path / "descriptors")
    again = Descriptors.load(tmp_path / "descriptors")
    np.testing.assert_array_equal(again.images, described.images)
    assert again.seconds == described.seconds


def test_keyframes_of_several_settings_are_those_of_each_alone() -> None:
    settings = [KeyframeSettings(distance_m=0.5), KeyframeSettings(distance_m=0.8, cloud_voxel_size_m=0.4)]
    scans = [Scan(k * 10**8, room(se3.from_yaw(0.02 * k, np.array([0.1 * k, 0.02 * k, 0.0])))) for k in range(12)]

    def results(of: list[KeyframeSettings]) -> tuple[OdometryResult, ...]:
        run = OdometryRun(OdometrySettings(), of, "alpha")
        for scan in scans:
            run.process(scan)
        return run.results()

    for setting, together in zip(settings, results(settings), strict=True):
        (alone,) = results([setting])
        np.testing.assert_array_equal(together.poses, alone.poses)
        assert together.keyframe_indices.tolist() == alone.keyframe_indices.tolist()
        for cloud, expected in zip(together.clouds, alone.clouds, strict=True):
            np.testing.assert_array_equal(cloud, expected)


def test_a_result_carries_robot_and_drift_of_the_run() -> None:
    result = walk(3, DriftModel(translation_walk=0.07))
    assert (result.robot, result.keyframes.drift.translation_walk) == ("alpha", 0.07)


def test_a_cloud_of_several_scans_shows_what_each_of_them_shows() -> None:
    def clouds(scans: int) -> list[FloatArray]:
        run = start(keyframes=KeyframeSettings(distance_m=0.5, scans=scans))
        for k in range(11):
            points = room(se3.from_yaw(0.02 * k, np.array([0.1 * k, 0.02 * k, 0.0])), seed=k)
            seen = points[:, 0] > 0 if k % 2 else points[:, 0] < 0  # each scan shows one half
            run.process(Scan(k * 100_000_000, points[seen]))
        return [np.asarray(cloud, float) for cloud in run.results()[0].clouds]

    for alone, together in zip(clouds(1)[1:], clouds(3)[1:], strict=True):
        half = abs(np.mean(alone[:, 0] > 0.3) - 0.5)
        whole = abs(np.mean(together[:, 0] > 0.3) - 0.5)
        assert whole < 0.3 < half


@pytest.mark.parametrize("scans", [1, 3])
def test_points_of_keyframes_keep_the_intensity_of_the_returns_they_stand_for(tmp_path: Path, scans: int) -> None:
    """One half of the room is dark and one bright; some returns lie too far, some intensities are no numbers."""
    run = start(keyframes=KeyframeSettings(distance_m=0.5, scans=scans))
    for k in range(11):
        pose = se3.from_yaw(0.02 * k, np.array([0.1 * k, 0.02 * k, 0.0]))
        points = np.insert(room(pose), [0, 500], [[500.0, 0, 0], [0, 700.0, 0]], axis=0)
        intensity = np.where(se3.transform(pose, points)[:, 0] > 0, 200.0, 20.0)
        intensity[[0, 501]], intensity[7::50] = 9.0, np.nan
        run.process(Scan(k * 100_000_000, points, intensity=intensity.astype(np.float32)))
    (found,) = run.results()
    found.save(tmp_path / "saved")
    loaded = OdometryResult.load(tmp_path / "saved")
    assert found.intensities is not None
    assert loaded.intensities is not None
    for index, cloud, seen, again in zip(
        found.keyframe_indices, found.clouds, found.intensities, loaded.intensities, strict=True
    ):
        across = se3.transform(found.poses[index], np.asarray(cloud, float))[:, 0]
        clear = np.abs(across) > 0.5
        np.testing.assert_array_equal(seen[clear], np.where(across[clear] > 0, 200, 20))
        np.testing.assert_array_equal(seen, again)


def test_without_intensities_there_are_none() -> None:
    assert walk(3, DriftModel()).intensities is None


@pytest.mark.parametrize("damage", ["cut to 0", "cut to 10", "cut to 500", "a byte turned"])
def test_damaged_saved_stages_are_one_clear_error(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "alpha.cache"
    run = start()
    run.process(Scan(0, room(np.eye(4))))
    run.results()[0].save(path)
    content = bytearray(path.read_bytes())
    if damage == "a byte turned":
        content[len(content) // 2] ^= 0xFF
    else:
        content = content[: int(damage.rsplit(maxsplit=1)[-1])]
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"alpha.cache is not a saved odometry"):
        OdometryResult.load(path)
    with pytest.raises(InputError, match=r"alpha.cache holds no saved descriptors"):
        Descriptors.load(path)


def test_scans_without_points_and_late_scans_are_left_out_and_counted() -> None:
    run = start()
    for stamp_ns, points in (
        (0, np.zeros((0, 3))),
        (10, room(np.eye(4))),
        (20, np.full((500, 3), 1e4)),
        (10, room(np.eye(4))),
        (5, room(np.eye(4))),
        (30, room(np.eye(4))),
    ):
        run.process(Scan(stamp_ns, points))
    (result,) = run.results()
    assert result.stamps_ns.tolist() == [10, 30]
    assert (result.counts.scans, result.counts.sparse, result.counts.late) == (6, 2, 2)


def test_no_usable_scan_is_an_error_that_names_the_robot_and_the_range() -> None:
    run = OdometryRun(OdometrySettings(min_range_m=50.0), [KEYFRAMES], "beta")
    run.process(Scan(0, room(np.eye(4))))
    with pytest.raises(InputError, match="robot beta: none of 1 scans has 100 points between 50 and 100 m"):
        run.results()


@pytest.mark.slow
def test_a_recorded_drive_has_its_true_length(kitti_drive: Drive) -> None:
    run = start()
    run.process_all(kitti_drive[index] for index in range(len(kitti_drive)))
    (result,) = run.results()
    assert Trajectory("alpha", result.stamps_ns, result.poses).distance[-1] == pytest.approx(71.5, rel=0.01)
    assert len(result.stamps_ns) == len(kitti_drive)
