from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.pipeline.radio.check.geometry import pair_samples
from wiclosure.types import AoaPath, Trajectory, WirelessMeasurement

SECOND = 10**9


def heard(seconds: float, receiver: str, transmitter: str, **more: object) -> WirelessMeasurement:
    more = {"range_m": None, "range_sigma_m": None, "paths": ()} | more
    return WirelessMeasurement(round(seconds * SECOND), receiver, transmitter, **more)


def test_both_directions_are_sorted_by_time_and_antennas_stay_with_their_robot() -> None:
    here, there = (0.1, 0.0, 0.0), (0.0, 0.2, 0.0)
    measurements = [
        heard(2, "beta", "alpha", range_m=4.0, range_sigma_m=0.5, lever_arm_receiver=there, lever_arm_transmitter=here),
        heard(1, "alpha", "beta", paths=(AoaPath(0.3, 0.1, weight=0.2), AoaPath(-1.0, 0.1, weight=0.7)),
              lever_arm_receiver=here, lever_arm_transmitter=there),
        heard(1, "beta", "gamma", range_m=1.0, range_sigma_m=0.5),
    ]  # fmt: skip
    samples = pair_samples(measurements)
    assert list(samples) == [("alpha", "beta"), ("beta", "gamma")]
    both = samples["alpha", "beta"]
    assert both.stamps_ns.tolist() == [SECOND, 2 * SECOND]
    assert both.a_received.tolist() == [True, False]
    np.testing.assert_array_equal(both.arms_a, [here, here])
    np.testing.assert_array_equal(both.arms_b, [there, there])
    np.testing.assert_array_equal(both.ranges_m, [np.nan, 4.0])
    np.testing.assert_array_equal(both.azimuths_rad, [-1.0, np.nan])  # of the strongest path
    assert both.select(np.array([False, True])).stamps_ns.tolist() == [2 * SECOND]


def test_antennas_are_where_the_robots_carry_them_at_the_time_of_the_clock() -> None:
    stamps_ns = np.arange(4) * SECOND
    along = se3.from_yaw(np.full(4, np.pi / 2), np.array([[0.0, y, 0.0] for y in range(4)]))
    trajectories = {
        "alpha": Trajectory("alpha", stamps_ns, along),
        "beta": Trajectory("beta", stamps_ns, np.tile(np.eye(4), (4, 1, 1))),
    }
    heard_at = [
        heard(t, "alpha", "beta", range_m=5.0, range_sigma_m=0.5, lever_arm_receiver=(1.0, 0.0, 0.5))
        for t in (0.5, 2.5)
    ]
    (samples,) = pair_samples(heard_at).values()
    a, b = samples.antennas(trajectories)
    np.testing.assert_allclose(a, [[0.0, 1.5, 0.5], [0.0, 3.5, 0.5]], atol=1e-12)
    np.testing.assert_allclose(b, 0.0, atol=1e-12)
    later, _ = samples.antennas(trajectories, SECOND // 2)
    np.testing.assert_allclose(later[:, 1], [2.0, 4.0], atol=1e-12)
    assert samples.covered(trajectories).tolist() == [True, True]
    assert samples.covered(trajectories, SECOND).tolist() == [True, False]
    assert samples.covered(trajectories, -SECOND).tolist() == [False, True]
