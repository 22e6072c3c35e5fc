from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis

ALIGNED = AlignmentHypothesis(se3.from_yaw(0.5, np.array([1.0, -2.0, 0.25])), -12.34, ((0, 0), (1, -1)))


def test_an_alignment_shows_where_it_lies():
    expected = "x 1.00 m, y -2.00 m, z 0.25 m, yaw 0.500 rad, log-likelihood -12.3, 2 paths"
    assert repr(ALIGNED) == f"AlignmentHypothesis({expected})"
