"""What every kind of odometry keeps to; a new one is tested by listing it in `ODOMETRIES`."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import ConfigError
from wiclosure.frontends.config import OdometrySettings
from wiclosure.frontends.odometry.kiss_odometry import KissOdometry
from wiclosure.frontends.odometry.recorded_odometry import RecordedOdometry
from wiclosure.frontends.odometry.registry import ODOMETRIES, make_odometry
from wiclosure.frontends.odometry.sweep import sweep_stamps_ns, sweep_times
from wiclosure.interfaces import Odometry
from wiclosure.types import FloatArray, Scan, Trajectory

SPEED = np.array([0.0, 0.0, 0.4, 3.0, 0.5, 0.0])  # rad/s about x y z, m/s along x y z
PERIOD_NS, START_NS = 100_000_000, 10**12


def poses_at(stamps_ns: np.ndarray) -> FloatArray:
    return se3.exp((np.asarray(stamps_ns) - START_NS)[:, None] * 1e-9 * SPEED)


TRUTH_NS = START_NS + np.arange(-50, 1550, 5) * 1_000_000
TRUTH = Trajectory("alpha", TRUTH_NS, poses_at(TRUTH_NS))


def walls() -> FloatArray:
    rng = np.random.default_rng(0)
    points = rng.uniform([-15, -10, -1], [15, 10, 4], (9000, 3))
    side = rng.integers(0, 5, len(points))
    for face, (axis, value) in enumerate(((0, -15), (0, 15), (1, -10), (1, 10), (2, -1))):
        points[side == face, axis] = value
    return points


def scans(count: int) -> list[Scan]:
    """A room as a sensor sees it that moves evenly and measures each point at its own time."""
    times = np.random.default_rng(1).permutation(np.linspace(0.0, 0.1, len(walls())))
    found = []
    for k in range(count):
        stamp_ns = START_NS + k * PERIOD_NS
        T_world_body = poses_at(stamp_ns + np.rint(times * 1e9).astype(np.int64))
        found.append(Scan(stamp_ns, se3.transform(se3.inverse(T_world_body), walls()), times))
    return found


@pytest.fixture(params=list(ODOMETRIES))
def odometry(request: pytest.FixtureRequest) -> Odometry:
    return ODOMETRIES[request.param](OdometrySettings(voxel_size_m=0.5, min_range_m=2.0, max_range_m=18.0), TRUTH)


def test_it_follows_a_room_and_pose_and_points_belong_to_the_last_point(odometry: Odometry) -> None:
    found = []
    for scan in scans(12):
        assert odometry.covers(scan)
        stamp_ns, T_odom_body, points = odometry.register(scan)
        assert stamp_ns == scan.stamp_ns + PERIOD_NS
        found.append((stamp_ns, T_odom_body))
    stamps_ns = np.array([stamp_ns for stamp_ns, _ in found])
    # The first few are followed before there is a motion to deskew by.
    moved = se3.between(found[3][1], found[-1][1])
    expected = se3.between(poses_at(stamps_ns[3:4])[0], poses_at(stamps_ns[-1:])[0])
    assert np.abs(se3.log(se3.between(expected, moved))).max() < 0.1
    # Deskewed points lie on the walls as they are seen from the last pose; those of the scan itself do not.
    distances = np.linalg.norm(points, axis=1)
    within_sweep_m = 0.35  # how far it moves: ranges count where points were measured, or where the sweep ends
    assert 2.0 - within_sweep_m < distances.min() < distances.max() < 18.0 + within_sweep_m
    in_world = se3.transform(poses_at(stamps_ns[-1:])[0], points)
    to_wall = np.abs(in_world[:, :1] - [-15, 15]).min(axis=1)
    to_wall = np.minimum(to_wall, np.abs(in_world[:, 1:2] - [-10, 10]).min(axis=1))
    to_wall = np.minimum(to_wall, np.abs(in_world[:, 2] + 1))
    assert np.quantile(to_wall, 0.95) < 0.05


def test_thinned_points_are_of_the_last_scan_one_a_voxel(odometry: Odometry) -> None:
    with pytest.raises(ValueError, match="no scan was registered yet"):
        _ = odometry.thinned
    for scan in scans(2):
        _, _, points = odometry.register(scan)
        assert odometry.voxel_size_m == 0.5
        thinned = odometry.thinned
        assert 0.2 * len(points) < len(thinned) < len(points)
        nearest = np.array([np.linalg.norm(points - one, axis=1).min() for one in thinned[::50]])
        assert nearest.max() < 0.25


def test_the_voxel_follows_the_surroundings_where_nobody_sets_it() -> None:
    sizes = []
    for make in ODOMETRIES.values():
        odometry = make(OdometrySettings(), TRUTH)
        assert np.isnan(odometry.voxel_size_m)
        odometry.register(scans(1)[0])
        sizes.append(odometry.voxel_size_m)
    assert sizes == [0.5, 0.5]


def test_scans_beyond_a_recorded_trajectory_are_not_covered() -> None:
    odometry = ODOMETRIES["recorded"](OdometrySettings(), TRUTH)
    times = np.array([0.0, 0.1])
    last_ns = int(TRUTH_NS[-1])
    assert odometry.covers(Scan(last_ns - PERIOD_NS, np.ones((2, 3)), times))
    assert odometry.covers(Scan(last_ns + PERIOD_NS // 2, np.ones((2, 3)), times))  # rounded stamps lose nothing
    assert not odometry.covers(Scan(last_ns + PERIOD_NS // 2 + 1, np.ones((2, 3)), times))
    assert not odometry.covers(Scan(int(TRUTH_NS[0]) - PERIOD_NS, np.ones((2, 3))))


def test_the_settings_and_what_the_robot_brings_choose() -> None:
    assert isinstance(make_odometry(OdometrySettings(), TRUTH), RecordedOdometry)
    assert isinstance(make_odometry(OdometrySettings(source="kiss-icp"), TRUTH), KissOdometry)
    assert isinstance(make_odometry(OdometrySettings()), KissOdometry)
    with pytest.raises(ConfigError, match="recorded odometry needs a trajectory"):
        ODOMETRIES["recorded"](OdometrySettings(), None)


def test_every_source_of_the_settings_is_listed() -> None:
    assert set(ODOMETRIES) == set(OdometrySettings.model_fields["source"].annotation.__args__)  # type: ignore[union-attr]  # a Literal


def test_a_sweep_lasts_from_its_first_to_its_last_point() -> None:
    scan = Scan(1_700_000_000_123_456_789, np.ones((3, 3)), np.array([0.02, -0.05, 0.04]))
    settings = OdometrySettings()
    assert (sweep_stamps_ns(scan, settings) - scan.stamp_ns).tolist() == [-50_000_000, 40_000_000]
    still = OdometrySettings(deskew=False)
    assert len(sweep_times(scan, still)) == 0
    assert (sweep_stamps_ns(scan, still) == scan.stamp_ns).all()
    alike = Scan(5, np.ones((2, 3)), np.array([0.05, 0.05]))
    assert sweep_stamps_ns(alike, settings).tolist() == [5, 5]
