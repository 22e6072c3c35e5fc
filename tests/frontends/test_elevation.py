from __future__ import annotations

import numpy as np
from kiss_icp.pybind import kiss_icp_pybind

from wiclosure import se3
from wiclosure.frontends.config import KeyframeSettings, OdometrySettings
from wiclosure.frontends.elevation import elevation_corrected
from wiclosure.frontends.front_end import OdometryRun
from wiclosure.types import Scan


def test_it_is_what_kiss_icp_does_to_scans_of_kitti() -> None:
    points = np.random.default_rng(0).uniform([-80, -80, -3], [80, 80, 5], (1000, 3))
    theirs = np.asarray(kiss_icp_pybind._correct_kitti_scan(kiss_icp_pybind._Vector3dVector(points)))
    ours = elevation_corrected(points, 0.205)
    np.testing.assert_allclose(ours, theirs, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(ours, axis=1), np.linalg.norm(points, axis=1))
    np.testing.assert_allclose(elevation_corrected(points, 0.0), points)


def test_straight_up_is_a_direction_too() -> None:
    assert np.isfinite(elevation_corrected(np.array([[0.0, 0.0, 2.0]]), 0.2)).all()


def test_scans_are_corrected_before_anything_looks_at_them() -> None:
    rng = np.random.default_rng(1)
    walls = np.concatenate([rng.uniform([-20, s, -1], [20, s, 3], (3000, 3)) for s in (-8, 8)])
    walls = np.concatenate([walls, rng.uniform([15, -8, -1], [15, 8, 3], (3000, 3))])
    seen = [se3.transform(se3.from_yaw(0.0, np.array([-0.3 * k, 0.0, 0.0])), walls) for k in range(5)]

    def top_of_the_front_wall_m(error_deg: float, correction_deg: float) -> float:
        run = OdometryRun(OdometrySettings(elevation_correction_deg=correction_deg), [KeyframeSettings()], "alpha")
        for k, points in enumerate(seen):
            run.process(Scan(k * 100_000_000, elevation_corrected(points, -error_deg)))
        cloud = run.results()[0].clouds[0]
        return float(cloud[cloud[:, 0] > 14.0, 2].max())

    assert abs(top_of_the_front_wall_m(1.0, 1.0) - 3.0) < 0.05
    assert top_of_the_front_wall_m(1.0, 0.0) < 2.8
