"""From a log to directions up: what is used, and what is refused with a sentence."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.frontends.inertial.estimate import estimate_up
from wiclosure.types import ImuLog


def changed(imu, acceleration=None, rate=None, stamps_ns=None):
    return ImuLog(
        imu.stamps_ns if stamps_ns is None else stamps_ns,
        imu.acceleration if acceleration is None else acceleration,
        imu.turning_rate if rate is None else rate,
    )


def linear(imu, truth):
    """As drivers give it that take gravity out."""
    R = truth.at(imu.stamps_ns)[:, :3, :3]
    return changed(imu, imu.acceleration - 9.81 * R[:, 2])


MIRROR = np.array([1, -1, 1])

FAULTS = {
    "g": (lambda imu, truth: changed(imu, imu.acceleration / 9.81), "in g"),
    "degrees": (lambda imu, truth: changed(imu, rate=np.degrees(imu.turning_rate)), "in degrees"),
    "sign": (lambda imu, truth: changed(imu, -imu.acceleration), "sign is wrong"),
    "late": (lambda imu, truth: changed(imu, stamps_ns=imu.stamps_ns + 500_000_000), "ahead of the scans'"),
    "hour": (lambda imu, truth: changed(imu, stamps_ns=imu.stamps_ns + 3600 * 10**9), "never overlap"),
    "linear": (linear, "gravity was taken out"),
    "stuck": (lambda imu, truth: changed(imu, 0 * imu.acceleration + [0, 0, 9.8], 0 * imu.turning_rate), "repeats"),
    "mirror": (lambda imu, truth: changed(imu, imu.acceleration * MIRROR, imu.turning_rate * MIRROR), "left-handed"),
    "exchanged": (lambda imu, truth: changed(imu, imu.acceleration[:, [1, 0, 2]]), r"\+y, \+x, \+z .* right-handed"),
    "turned": (lambda imu, truth: changed(imu, imu.acceleration[:, [1, 0, 2]] * MIRROR), r"of its turning rates"),
    "upside down": (lambda imu, truth: changed(imu, imu.acceleration * [1, -1, -1]), r"\+x, -y, -z"),
    "no gyroscope": (lambda imu, truth: changed(imu, rate=0 * imu.turning_rate), "rates never change"),
    "tenth too long": (lambda imu, truth: changed(imu, 1.1 * imu.acceleration), "10.7. m/s.2 long"),
    "clipped aside": (
        lambda imu, truth: changed(imu, np.clip(imu.acceleration, [-50, -0.3, -50], [50, 0.3, 50])),
        "are needed",
    ),
    "dead": (lambda imu, truth: changed(imu, imu.acceleration * [1, 0, 1]), "along y never changes"),
    "short": (lambda imu, truth: imu.subset(np.arange(500)), "too few|are needed"),
    "empty": (lambda imu, truth: imu.subset(np.arange(1)), "1 samples"),
    "other": (lambda imu, truth: changed(imu, rate=np.roll(imu.turning_rate, len(imu) // 3, axis=0)), "do not follow"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_wrong_logs_are_left_out_with_a_sentence(name, imu, odometry, keyframes, truth):
    import re

    spoil, words = FAULTS[name]
    result = estimate_up(spoil(imu, truth), odometry, keyframes, np.eye(4))
    assert result.up is None
    assert result.T_level_odom is None
    assert re.search(words, result.sentences[-1])
    assert result.sentences[-1].startswith("its IMU is not used: ")


def test_axes_that_are_stated_wrong_are_noticed(imu, odometry, keyframes):
    for axis in np.eye(3):
        wrong = se3.from_rotation_translation(Rotation.from_rotvec(0.5 * axis).as_matrix(), np.zeros(3))
        result = estimate_up(imu, odometry, keyframes, wrong)
        assert result.up is None
        assert "29 degrees off" in result.sentences[-1] or "28 degrees off" in result.sentences[-1]


def test_parts_that_are_wrong_are_left_out_and_the_rest_is_used(imu, odometry, keyframes, truth):
    acceleration = imu.acceleration.copy()
    middle = len(imu) // 2
    acceleration[middle : middle + 300] = acceleration[middle]
    rate = imu.turning_rate.copy()
    rate[middle : middle + 300] = rate[middle]
    result = estimate_up(changed(imu, acceleration, rate), odometry, keyframes, np.eye(4))
    assert result.up is not None
    assert "300 of" in result.sentences[0]
    assert np.degrees(np.sqrt(np.mean(result.up.angles_off(truth.poses[::8, :3, :3]) ** 2))) < 0.4


@pytest.mark.parametrize("part", ["stuck", "pushed"])
def test_an_accelerometer_that_fails_for_a_while_is_left_out_for_that_while(part, imu, odometry, keyframes, truth):
    acceleration, while_it = imu.acceleration.copy(), slice(int(0.4 * len(imu)), int(0.6 * len(imu)))
    acceleration[while_it] = acceleration[while_it.start] if part == "stuck" else acceleration[while_it] + [3, 0, 0]
    result = estimate_up(changed(imu, acceleration), odometry, keyframes, np.eye(4))
    assert result.up is not None
    assert "left out" in " ".join(result.sentences)
    assert np.degrees(np.sqrt(np.mean(result.up.angles_off(truth.poses[::8, :3, :3]) ** 2))) < 0.6


@pytest.mark.parametrize("wrong", [-1.0, [1, -1, -1], [-1, 1, 1]])
def test_a_wrong_sign_is_not_explained_away_by_a_mounting(wrong, imu, odometry, keyframes):
    for spoilt in (changed(imu, imu.acceleration * wrong), changed(imu, rate=imu.turning_rate * wrong)):
        assert estimate_up(spoilt, odometry, keyframes).up is None


def test_a_mounting_that_is_not_told_is_found_and_said(turned_imu, odometry, keyframes, truth):
    T_lidar_imu, imu = turned_imu
    result = estimate_up(imu, odometry, keyframes)
    assert result.up is not None
    assert result.mounting is not None
    assert "were found" in result.sentences[0]
    assert np.degrees(np.sqrt(np.mean(result.up.angles_off(truth.poses[::8, :3, :3]) ** 2))) < 0.4
    told = estimate_up(imu, odometry, keyframes, T_lidar_imu)
    assert told.mounting is None
    assert told.up is not None
    assert len(told.up) == len(result.up)
