"""The simulated receiver: outages, wandering errors, reflections."""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.geodesy import enu_of
from wiclosure.simulation.sensors.gnss import GnssSettings, simulate_gnss
from wiclosure.simulation.world.motion import START_NS


class Straight:
    duration_ns = 600 * 10**9

    def T_world_body(self, stamps_ns):
        place = np.zeros((len(stamps_ns), 3))
        place[:, 0] = (stamps_ns - START_NS) * 1e-9
        return se3.from_yaw(np.zeros(len(stamps_ns)), place)


def off(settings, seed=0):
    log = simulate_gnss(Straight(), settings, np.random.default_rng(seed))
    origin = np.array([settings.latitude, settings.longitude, settings.height_m])
    true = Straight().T_world_body(log.stamps_ns)[:, :3, 3] + settings.antenna_lidar()
    return log, enu_of(log.geodetic, origin) - true


def test_errors_wander_slowly_about_the_truth():
    errors = np.concatenate([off(GnssSettings(gross=0.0, outages=0), seed)[1] for seed in range(30)])
    assert 1.2 < errors[:, 0].std() < 1.8
    assert 2.4 < errors[:, 2].std() < 3.6
    steps = np.diff(off(GnssSettings(gross=0.0, outages=0, noise_m=0.0))[1][:, 0])
    assert steps.std() < 0.5


def test_outages_and_reflections():
    log, errors = off(GnssSettings(outages=2, outage_s=40.0, gross=0.1))
    gaps = np.diff(log.stamps_ns) * 1e-9
    assert (gaps > 30).sum() == 2
    assert 0.05 < (np.linalg.norm(errors, axis=1) > 15).mean() < 0.15
