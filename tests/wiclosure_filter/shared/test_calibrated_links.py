"""Constant errors beside the joint estimate: derivatives, and what they leave open."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import AoaPath, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.alignment.calibration import AZIMUTH_A, BIAS, CLOCK, COUNT, RANGE_SCALE, motion
from wiclosure.wiclosure_filter.config import FilterSettings, SharedTrajectorySettings
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.shared.calibrated_links import LinkRows, without_errors
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

STEPS = 80


def meeting(scale: float = 1.0) -> tuple[dict[str, Trajectory], WirelessLog, dict[str, np.ndarray]]:
    """Two robots on crossing winding roads, with exact measurements; odometry of b too long by `scale`."""
    s = 1.0 * np.arange(STEPS)
    truth = {
        "a": se3.from_yaw(0.3 * np.sin(s / 9), np.stack([s, 6 * np.sin(s / 12), 0 * s], axis=1)),
        "b": se3.from_yaw(2.0 + 0.4 * np.cos(s / 7), np.stack([60 - s, 12 + 8 * np.cos(s / 10), 0 * s], axis=1)),
    }
    stamps_ns = np.arange(STEPS, dtype=np.int64) * 10**9
    heard = []
    for k in range(0, STEPS, 4):
        seen = se3.between(truth["a"][k], truth["b"][k])[:3, 3]
        path = AoaPath(float(np.arctan2(seen[1], seen[0])), 0.1)
        heard.append(WirelessMeasurement(k * 10**9, "a", "b", float(np.linalg.norm(seen)), 0.3, (path,)))
    b = se3.inverse(truth["b"][0]) @ truth["b"]
    b[:, :3, 3] *= scale
    team = {"a": Trajectory("a", stamps_ns, truth["a"]), "b": Trajectory("b", stamps_ns, b)}
    return team, WirelessLog(tuple(heard)), truth


def test_errors_are_taken_out_of_the_links() -> None:
    team, log, _ = meeting()
    chosen = WiClosureFilter()
    links = chosen.gather(team, log).by_pair["a", "b"]
    (alignment,) = chosen.candidates(team, log).alignments
    kept = KeptLinks.of(alignment.best, links)
    same = without_errors(kept, np.zeros(COUNT), team["b"])
    np.testing.assert_allclose(same.links.range_m, kept.links.range_m)
    np.testing.assert_allclose(same.direction, kept.direction)
    errors = np.zeros(COUNT)
    errors[BIAS], errors[AZIMUTH_A] = 0.5, 0.1
    corrected = without_errors(kept, errors, team["b"])
    np.testing.assert_allclose(corrected.links.range_m, np.maximum(kept.links.range_m - 0.5, 0))
    turned = np.arctan2(*corrected.direction[:, 1::-1].T) - np.arctan2(*kept.direction[:, 1::-1].T)
    np.testing.assert_allclose(se3.wrap_angle(turned), -0.1, atol=1e-9)


@pytest.mark.parametrize(("error", "column"), [(BIAS, 0), (RANGE_SCALE, 1), (CLOCK, 2), (AZIMUTH_A, 3)])
def test_derivatives_are_those_of_corrected_links(error: int, column: int) -> None:
    team, log, _ = meeting()
    chosen = WiClosureFilter()
    kept = KeptLinks.of(chosen.align(team, (links := chosen.gather(team, log).by_pair))["a", "b"].best, links["a", "b"])
    keys = np.arange(len(kept)), 100 + np.arange(len(kept))
    T_world_b = se3.from_yaw(2.0, np.array([60.0, 20.0, 0.0]))
    velocity = motion(team["b"], kept.links.index_b)[0]
    step = np.zeros(COUNT)
    step[error] = 1e-4

    def rows(corrected: KeptLinks, moved_m: float) -> LinkRows:
        values = gtsam.Values()
        for key, place in zip(keys[0], kept.links.antenna_a, strict=True):
            values.insert(int(key), gtsam.Pose3(gtsam.Rot3(), place))
        for key, place, v in zip(keys[1], kept.links.antenna_b, velocity, strict=True):
            at = T_world_b @ se3.from_yaw(0.0, place + moved_m * v)
            values.insert(int(key), gtsam.Pose3(at))
        return LinkRows.of(corrected, keys, velocity, values, 1e6)

    still = rows(kept, 0.0)
    moved = rows(without_errors(kept, step, team["b"]), step[CLOCK])
    expected = (moved.b - still.b) / step[error]
    scale = np.abs(still.by_errors[:, column]).max()
    np.testing.assert_allclose(still.by_errors[:, column], expected, atol=0.02 * scale)
    assert scale > 0


def test_an_odometry_that_is_too_long_lies_within_what_is_stated() -> None:
    team, log, truth = meeting(scale=1.03)
    (pairs,) = WiClosureFilter().candidates(team, log).pairs
    rows = np.arange(0, STEPS, 10)
    T, C = pairs.predictor.relative_poses("a", rows, "b", rows)
    off = (se3.between(truth["a"][rows], truth["b"][rows])[:, :3, 3] - T[:, :3, 3])[:, :2]
    off = np.einsum("mji,mj->mi", T[:, :2, :2], off)
    chi2 = np.einsum("mi,mi->m", off, np.linalg.solve(C[:, 3:5, 3:5], off[..., None])[..., 0])
    assert (chi2 < 4.6).mean() > 0.8


@pytest.mark.parametrize(("scale", "bias_m"), [(1.02, 0.0), (1 / 1.02, 0.0), (1.0, 0.6), (1.02, -0.6)])
def test_what_the_links_tell_of_constant_errors_moves_the_nodes_to_the_truth(scale: float, bias_m: float) -> None:
    team, log, truth = meeting(scale)
    ranged = tuple(replace(m, range_m=m.range_m + bias_m, range_sigma_m=0.05) for m in log.measurements)
    team = {name: replace(t, drift=t.drift.scaled(0.2)) for name, t in team.items()}
    chosen = WiClosureFilter(FilterSettings(shared_trajectory=SharedTrajectorySettings(drift_weight=1e9)))
    links = chosen.gather(team, WirelessLog(ranged)).by_pair
    (alignment,) = chosen.align(team, links).values()
    found = np.array([one.value for one in alignment.calibration])
    unknown = replace(alignment, calibration=(), ambiguous=False)
    half = tuple(replace(one, value=one.value / 2) for one in alignment.calibration)
    rows, off = np.arange(0, STEPS, 10), []
    for one in (unknown, replace(unknown, calibration=half), replace(alignment, ambiguous=False)):
        joint = chosen.share(team, links, [one]).estimates["a", "b"]
        T, _ = joint.relative_poses("a", rows, "b", rows)
        off.append(np.linalg.norm(T[:, :2, 3] - se3.between(truth["a"][rows], truth["b"][rows])[:, :2, 3], axis=1))
    assert np.abs(found).max() > 0.005
    assert off[2].mean() < 0.5 * off[0].mean()
    np.testing.assert_allclose(off[1], off[2], atol=0.25)  # wherever the links start; the kernel bends that a little


def test_without_known_errors_nothing_is_added() -> None:
    team, log, _ = meeting()
    chosen = WiClosureFilter()
    links = chosen.gather(team, log).by_pair
    alignments = chosen.align(team, links)
    knowing = [replace(a, calibration=(), calibration_covariance=None) for a in alignments.values()]
    rows = np.arange(0, STEPS, 10)
    variance = [
        chosen.share(team, links, list(of)).estimates["a", "b"].relative_poses("a", rows, "b", rows)[1]
        for of in (knowing, alignments.values())
    ]
    assert (np.trace(variance[1], axis1=1, axis2=2) > np.trace(variance[0], axis1=1, axis2=2)).all()
