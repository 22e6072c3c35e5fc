"""Links are corrected for what was estimated, and predictions are as vague as the rest leaves them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wiclosure import se3
from wiclosure.types import AoaPath, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.alignment.calibration import AZIMUTH_A, BIAS, COUNT
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.shared.calibrated_links import without_errors
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks


def meeting() -> tuple[dict[str, Trajectory], WirelessLog]:
    """Two robots on crossing winding roads, with exact measurements."""
    s = 1.0 * np.arange(80)
    a = se3.from_yaw(0.3 * np.sin(s / 9), np.stack([s, 6 * np.sin(s / 12), 0 * s], axis=1))
    b = se3.from_yaw(2.0 + 0.4 * np.cos(s / 7), np.stack([60 - s, 12 + 8 * np.cos(s / 10), 0 * s], axis=1))
    stamps_ns = np.arange(80, dtype=np.int64) * 10**9
    heard = []
    for k in range(0, 80, 4):
        seen = se3.between(a[k], b[k])[:3, 3]
        path = AoaPath(float(np.arctan2(seen[1], seen[0])), 0.1)
        heard.append(WirelessMeasurement(k * 10**9, "a", "b", float(np.linalg.norm(seen)), 0.3, (path,)))
    team = {"a": Trajectory("a", stamps_ns, a), "b": Trajectory("b", stamps_ns, se3.inverse(b[0]) @ b)}
    return team, WirelessLog(tuple(heard))


def test_errors_are_taken_out_of_the_links() -> None:
    team, log = meeting()
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


def test_predictions_carry_what_the_errors_leave_open() -> None:
    team, log = meeting()
    chosen = WiClosureFilter()
    links = chosen.gather(team, log).by_pair
    alignments = chosen.align(team, links)
    knowing = {pair: replace(a, calibration=(), calibration_covariance=None) for pair, a in alignments.items()}
    rows = np.arange(0, 80, 10)
    variance = [
        np.einsum(
            "mii->mi",
            chosen.share(team, links, list(of.values())).estimates["a", "b"].relative_poses("a", rows, "b", rows)[1],
        )
        for of in (knowing, alignments)
    ]
    assert (variance[1][:, 3:5].sum(axis=1) > variance[0][:, 3:5].sum(axis=1)).all()
