"""Level robots do not fly; those that climb may."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import Trajectory
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.likelihood.heights import height_sigma_m, slope

X = np.arange(0.0, 200.0)


def rising(grade: float) -> Trajectory:
    positions = np.column_stack([X, 0 * X, grade * X])
    return Trajectory("a", np.arange(len(X), dtype=np.int64) * 10**9, se3.from_yaw(0 * X, positions))


def test_the_slope_of_a_ramp_is_its_grade() -> None:
    assert slope(rising(0.1).positions, 30.0) == pytest.approx(0.1, rel=0.05)
    assert slope(rising(0.0).positions, 30.0) == 0.0
    assert slope(rising(0.1).positions[:1], 30.0) == 0.0


def test_level_robots_are_about_equally_high() -> None:
    settings = AlignmentSettings()
    level, ramp = rising(0.0), rising(0.2)
    assert height_sigma_m(level, level, 30.0, settings) == pytest.approx(np.hypot(0.5, 0.02 * 30))
    assert height_sigma_m(level, ramp, 30.0, settings) == pytest.approx(np.hypot(0.5, 0.2 * 30), rel=0.05)
    assert height_sigma_m(ramp, ramp, 500.0, settings) == settings.height_sigma_m
