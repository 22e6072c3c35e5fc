"""Frames set upright, positions at keyframes, and what is said of both."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.drift import DriftModel
from wiclosure.frontends.front_end_result import Descriptors, FrontEndCounts, FrontEndResult, OdometryResult
from wiclosure.pipeline.config import EarthSettings
from wiclosure.pipeline.data.inputs import GnssInput, ImuInput, Inputs, RobotInput
from wiclosure.pipeline.grounding.grounding import earth_metrics, grounded
from wiclosure.simulation.sensors.gnss import GnssSettings, simulate_gnss
from wiclosure.simulation.sensors.imu import ImuSettings, simulate_imu
from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.motion import START_NS, MotionSettings, drive
from wiclosure.types import WirelessLog

TILT = se3.from_rotation_translation(Rotation.from_euler("xy", [20, -12], degrees=True).as_matrix(), np.zeros(3))


@pytest.fixture(scope="module")
def setting():
    """One robot whose LiDAR is mounted at a slant: front end, recording, true poses of keyframes."""
    way = np.array([[0, 0], [40, 0], [60, 30], [30, 50], [0, 30], [-20, 60], [-40, 10.0]])
    motion = drive(way, rough_ground(np.random.default_rng(2), (-60.0, -40.0), (90.0, 90.0), 0.5),
                   MotionSettings(speed_mps=3.0, sway_deg=0.1))  # fmt: skip
    stamps_ns = START_NS + np.arange(0, motion.duration_ns, 10**8, dtype=np.int64)
    truth = motion.T_world_body(stamps_ns) @ TILT
    rows = np.arange(0, len(stamps_ns), 5)
    clouds = tuple(np.zeros((1, 3), np.float32) for _ in rows)
    followed = OdometryResult(stamps_ns, stamps_ns, se3.between(truth[:1], truth), rows, clouds,
                              FrontEndCounts(len(stamps_ns), 0, 0, 0), 0.0, 0.0)  # fmt: skip
    described = Descriptors(np.zeros((len(rows), 2, 2), np.float32), 0.0)
    front = FrontEndResult.of("alpha", DriftModel(), followed, described)
    rng = np.random.default_rng(0)
    mounting = ImuSettings()
    imu = simulate_imu(motion, mounting, rng)
    gnss_settings = GnssSettings(sigma_m=0.3, correlation_s=5.0, gross=0.0, outage_s=10.0)
    gnss = simulate_gnss(motion, gnss_settings, rng)
    T_lidar_level = se3.inverse(TILT)
    antenna = T_lidar_level[:3, :3] @ gnss_settings.antenna_lidar()
    robot = RobotInput("alpha", (), "x", None, imu=ImuInput(imu, T_lidar_level @ mounting.T_lidar_imu()),
                       gnss=GnssInput(gnss, antenna))  # fmt: skip
    return front, Inputs((robot,), WirelessLog()), truth[rows]


def test_a_slanted_mounting_is_set_upright(setting):
    front, inputs, truth = setting
    found = grounded({"alpha": front}, inputs, EarthSettings(gnss=False))
    R = found.fronts["alpha"].keyframes.poses[:, :3, :3]
    off = np.arccos(np.clip(np.einsum("nj,nj->n", R[:, 2], truth[:, 2, :3]), -1, 1))
    assert np.degrees(off).max() < 0.5
    assert any("leans by 2" in sentence for sentence in found.sentences)
    np.testing.assert_allclose(
        found.T_level_odom["alpha"] @ front.keyframes.poses, found.fronts["alpha"].keyframes.poses, atol=1e-9
    )
    assert found.origin is None


def test_switched_off_nothing_is_done(setting):
    front, inputs, _ = setting
    found = grounded({"alpha": front}, inputs, EarthSettings(gravity=False, gnss=False))
    assert not found.earth
    assert found.fronts["alpha"] is front


def test_positions_place_the_map(setting):
    front, inputs, truth = setting
    found = grounded({"alpha": front}, inputs, EarthSettings())
    keyframes = found.fronts["alpha"].keyframes
    result = optimise({"alpha": keyframes}, [], earth=found.earth)
    metrics = earth_metrics(found, result)
    assert metrics["frame"] == "east-north-up"
    assert metrics["placed"] == ["alpha"]
    assert metrics["origin"]["latitude"] == pytest.approx(GnssSettings().latitude, abs=1e-4)
    at = result.trajectories["alpha"].positions - result.trajectories["alpha"].positions[0]
    true = truth[:, :3, 3] - truth[0, :3, 3]
    assert np.linalg.norm(at - true, axis=1).mean() < 1.5  # the simulated world's x points east
    assert metrics["up"]["alpha"]["outvoted"] == 0


def test_where_odometry_slips_the_imu_goes_on(setting):
    front, inputs, _ = setting
    steps = se3.between(front.odometry.poses[:-1], front.odometry.poses[1:])
    steps[200:230, :3, 3] *= 0.4
    poses = [front.odometry.poses[0]]
    for step in steps:
        poses.append(poses[-1] @ step)
    rng = np.random.default_rng(1)
    noise = se3.exp(rng.normal(size=(len(poses), 6)) * np.repeat([0.001, 0.01], 3))
    off = front.replaced(replace(front.odometry, poses=np.stack(poses) @ noise), np.zeros(len(steps), bool))
    found = grounded({"alpha": off}, inputs, EarthSettings(gnss=False))
    assert any("otherwise than its IMU felt" in sentence for sentence in found.sentences)

    def whole(path):
        return se3.between(*path.keyframes.poses[[0, -1]])[:3, 3]

    before, after = (np.linalg.norm(whole(path) - whole(front)) for path in (off, found.fronts["alpha"]))
    assert after < 0.4 * before
    mended = found.fronts["alpha"]
    np.testing.assert_allclose(mended.keyframes.poses, mended.odometry.poses[front.keyframe_indices], atol=1e-9)
    np.testing.assert_allclose(mended.scans.poses, mended.odometry.poses, atol=1e-9)


def _estimate(front, inputs, geodetic):
    """What a changed log of fixes comes to: what is known of the Earth, and the estimate."""
    robot = inputs.robots[0]
    log = replace(robot.gnss.log, geodetic=geodetic)
    changed = replace(inputs, robots=(replace(robot, gnss=replace(robot.gnss, log=log)),))
    found = grounded({"alpha": front}, changed, EarthSettings(gravity=False))
    result = optimise({"alpha": found.fronts["alpha"].keyframes}, [], earth=found.earth)
    return found, result


@pytest.mark.parametrize(
    ("rows", "value", "sentence"),
    [
        (slice(0, 3), [0.0, 0.0, 0.0], "3 of .* at 0/0"),
        (slice(0, 3), [np.nan] * 3, "3 of .* not finite"),
        (slice(0, 1), [8.4229, 49.0112, 115.0], "1 of .* farther from the others"),
        (slice(30, 60), [49.0112, 8.4229, 115.0], "29 of .* repeat"),
    ],
)
def test_fixes_that_cannot_be_true_are_left_out(setting, rows, value, sentence):
    front, inputs, _ = setting
    geodetic = inputs.robots[0].gnss.log.geodetic.copy()
    geodetic[rows] = value
    found, result = _estimate(front, inputs, geodetic)
    assert any(re.search(sentence, said) for said in found.sentences)
    assert result.ground.placed == ("alpha",)
    assert found.origin[0] == pytest.approx(49.0112, abs=0.01)


def test_fixes_that_do_not_follow_the_path_leave_the_frame_alone(setting):
    front, inputs, _ = setting
    swapped = inputs.robots[0].gnss.log.geodetic[:, [1, 0, 2]]
    _, result = _estimate(front, inputs, swapped)
    assert result.ground.placed == ()
    assert any("do not follow the path" in sentence for sentence in result.ground.diagnosis)


def test_a_log_without_one_place_is_said(setting):
    front, inputs, _ = setting
    found, result = _estimate(front, inputs, np.zeros_like(inputs.robots[0].gnss.log.geodetic))
    assert found.origin is None
    assert any("none of its 0 usable GNSS fixes" in sentence for sentence in found.sentences)
    assert result.ground.placed == ()
