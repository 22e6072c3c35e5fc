"""Links without the constant errors that were estimated of them."""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.wiclosure_filter.drift.calibration import AZIMUTH_A, BIAS, COUNT
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.shared.calibrated_links import without_errors
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

from .crossing_roads import meeting


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
