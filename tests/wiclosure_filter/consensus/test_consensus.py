"""The peaks of the posterior: the true one first, whatever reflections say."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.wiclosure_filter.consensus.consensus import consensus


@pytest.mark.parametrize("kind", ["heading", "reciprocal", "one-way", "bearing-only"])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_best_peak_is_the_truth_among_false_paths(kind: str, seed: int, make_case: Callable[..., object]) -> None:
    case = make_case(kind, seed=seed, heard=20, false_paths=1 if kind == "bearing-only" else 4)
    found = consensus(case.problem, 6_000)
    assert found is not None
    off = found.peaks.states[0] - case.state
    assert abs(se3.wrap_angle(off[0])) < 0.1
    assert np.linalg.norm(off[1:3]) < 1.5
    assert (np.diff(found.peaks.log_posterior) <= 0).all()
    assert found.chosen is None


def test_ranges_alone_find_the_truth_or_its_mirror(make_case: Callable[..., object]) -> None:
    case = make_case("range-only", heard=30)
    found = consensus(case.problem, 6_000)
    assert found is not None
    assert np.abs(found.peaks.states - case.state)[:, 1:3].max(axis=1).min() < 0.1


def test_nothing_can_be_proposed_from_one_range(make_case: Callable[..., object]) -> None:
    assert consensus(make_case("range-only", heard=1).problem, 6_000) is None


def test_peaks_of_several_anchors_are_told_under_one_drift(make_case: Callable[..., object]) -> None:
    case = make_case(heard=60, false_paths=2)  # so many measurements have more than one anchor
    found = consensus(case.problem, 6_000)
    assert found is not None
    assert found.drift[0].min() == 0.0  # that of one of the measurements
    assert np.linalg.norm((found.peaks.states[0] - case.state)[1:3]) < 0.5
