"""The log of an IMU."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure.errors import InputError
from wiclosure.types import ImuLog


def test_samples_in_other_axes():
    R = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    log = ImuLog(np.arange(2), np.tile([1.0, 0, 9.8], (2, 1)), np.tile([0, 1.0, 0], (2, 1))).turned(R)
    np.testing.assert_allclose(log.acceleration[0], [0, 1, 9.8], atol=1e-12)
    np.testing.assert_allclose(log.turning_rate[0], [-1, 0, 0], atol=1e-12)
    assert len(log.subset(np.array([True, False]))) == 1
    assert "2 samples" in repr(log)


@pytest.mark.parametrize(
    ("stamps", "shape", "words"), [([0, 1], (3, 3), "expected"), ([1, 1], (2, 3), "increase"), ([2, 1], (2, 3), "sort")]
)
def test_samples_that_do_not_belong_together(stamps, shape, words):
    with pytest.raises(InputError, match=words):
        ImuLog(np.array(stamps), np.zeros(shape), np.zeros(shape))
