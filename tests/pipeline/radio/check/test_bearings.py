from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.pipeline.radio.check.bearings import check_bearings
from wiclosure.pipeline.radio.check.geometry import pair_samples
from wiclosure.pipeline.radio.check.range_fit import fit_ranges
from wiclosure.types import AoaPath, Trajectory, WirelessMeasurement

N = 240


def winding(robot: str, seed: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    yaw = rng.uniform(0, 6) + np.cumsum(0.5 * np.sin(np.arange(N) * rng.uniform(0.2, 0.5)))
    steps = np.column_stack([np.cos(yaw), np.sin(yaw), 0 * yaw])
    R = Rotation.from_rotvec(np.column_stack([0 * yaw, 0 * yaw, yaw])).as_matrix()
    return Trajectory(robot, np.arange(N) * 10**9, se3.from_rotation_translation(R, np.cumsum(steps, 0) + 9.0 * seed))


TRUTH = {robot: winding(robot, seed) for seed, robot in enumerate(("alpha", "beta"), start=1)}
ODOMETRY = {robot: path.moved(se3.inverse(path.poses[0])) for robot, path in TRUTH.items()}


def findings(told=lambda bearing, yaw: bearing, noise=0.02, odometry=ODOMETRY, with_fit=True):
    """What is found where alpha tells bearings of beta as `told` says, from the bearing in its body and its yaw."""
    rng = np.random.default_rng(0)
    a, b = TRUTH["alpha"], TRUTH["beta"]
    to_b = b.positions - a.positions
    yaw = se3.yaw(a.poses)
    bearing = np.arctan2(to_b[:, 1], to_b[:, 0]) - yaw
    azimuths = np.angle(np.exp(1j * (told(bearing, yaw) + rng.normal(0, noise, N))))
    measurements = [
        WirelessMeasurement(
            k * 10**9, "alpha", "beta", float(np.linalg.norm(to_b[k])), 0.1, (AoaPath(azimuths[k], 0.1),)
        )
        for k in range(N)
    ]
    (samples,) = pair_samples(measurements).values()
    fit = fit_ranges(*samples.antennas(odometry), samples.ranges_m) if with_fit else None
    return check_bearings(samples, odometry, fit)


def test_right_bearings_fit_with_their_zero_ahead():
    found = findings()
    assert [finding.level for finding in found] == ["good", "good"]
    assert found[0].text.startswith("bearings count to the left")
    assert found[1].text.startswith("azimuth 0 is forward, as far as ranges tell (")


@pytest.mark.parametrize(
    ("told", "settings"),
    [
        (lambda bearing, yaw: -bearing, {"clockwise": True}),
        (lambda bearing, yaw: bearing - np.pi / 2, {"azimuth_zero": "left"}),
        (lambda bearing, yaw: bearing + np.pi, {"azimuth_zero": "back"}),
        (lambda bearing, yaw: np.pi / 2 - bearing, {"clockwise": True, "azimuth_zero": "left"}),
        (lambda bearing, yaw: bearing + yaw, {"aoa_frame": "odometry"}),
    ],
    ids=["clockwise", "from the left", "from behind", "clockwise from the left", "in fixed axes"],
)
def test_each_fault_is_named_with_its_key(told, settings):
    found: dict[str, object] = {}
    for finding in findings(told):
        found |= finding.settings
    assert found == settings


def test_noise_is_said_to_tell_nothing():
    (finding,) = findings(noise=2.0)
    assert (finding.level, finding.text.startswith("too noisy to tell")) == ("note", True)


def test_without_ranges_only_the_handedness_is_told():
    assert [finding.text[:12] for finding in findings(with_fit=False)] == ["bearings cou"]


def test_a_robot_that_never_turns_tells_no_handedness():
    straight = np.tile(np.eye(4), (N, 1, 1))
    straight[:, 0, 3] = np.arange(N)
    odometry = ODOMETRY | {"alpha": Trajectory("alpha", np.arange(N) * 10**9, straight)}
    first, *_ = findings(odometry=odometry, with_fit=False)
    assert (first.level, first.text) == (
        "note", "the robots turned too little between bearings to tell which way they count (0 turns)"
    )  # fmt: skip
