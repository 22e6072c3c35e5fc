"""When an alignment is certain: peaks made by hand, each with one doubt."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.alignment.ambiguity import Selection, assess, log_evidence
from wiclosure.wiclosure_filter.config import AmbiguitySettings
from wiclosure.wiclosure_filter.consensus.refinement import Peaks

SHARP = np.diag([1e4, 1e2, 1e2, 1e2])


def assessed(
    case: object, offsets: list[list[float]], log_posterior: list[float], information: FloatArray = SHARP
) -> Selection:
    states = case.state + np.array(offsets)
    peaks = Peaks(states, np.array(log_posterior), np.tile(information, (len(states), 1, 1)))
    mixture, _ = case.problem.anchored_at(0)
    return assess(peaks, mixture, case.problem.prior, AmbiguitySettings())


def test_one_sharp_and_likely_peak_is_certain(make_case: Callable[..., object]) -> None:
    case = make_case()
    selection = assessed(case, [[0, 0, 0, 0]], [100.0])
    assert not selection.ambiguous
    assert (selection.best, selection.second, selection.alternatives, selection.others) == (0, None, (), ())
    np.testing.assert_allclose(selection.covariance, np.linalg.inv(SHARP), rtol=1e-4)
    assert selection.reason == "12 bearings and 12 ranges of 12 measurements agree"


def test_two_equal_peaks_are_alternatives_to_each_other(make_case: Callable[..., object]) -> None:
    selection = assessed(make_case(), [[0, 0, 0, 0], [0, 30, 0, 0]], [100.0, 100.0])
    assert selection.ambiguous
    assert (selection.best, selection.second, selection.alternatives) == (0, 1, (1,))
    assert selection.reason == "an alignment 30.0 m away is nearly as likely (odds 1.0 to 1)"


@pytest.mark.parametrize(("odds", "ambiguous"), [(19.0, True), (21.0, False)])
def test_twenty_to_one_is_certain(odds: float, ambiguous: bool, make_case: Callable[..., object]) -> None:
    selection = assessed(make_case(), [[0, 0, 0, 0], [0, 30, 0, 0]], [100.0, 100.0 - np.log(odds)])
    assert selection.ambiguous == ambiguous
    assert selection.second == 1
    assert selection.alternatives == ((1,) if ambiguous else ())


def test_more_alternatives_than_the_search_can_follow_are_none(make_case: Callable[..., object]) -> None:
    many = [[0, 30.0 * k, 0, 0] for k in range(6)]
    selection = assessed(make_case(), many, [100.0] * 6)
    assert selection.ambiguous
    assert selection.alternatives == ()
    assert selection.others == (1,)
    three = assessed(make_case(), many[:3], [100.0, 99.0, 98.5])
    assert three.alternatives == (1, 2)


def test_peaks_of_one_place_are_folded_into_the_covariance(make_case: Callable[..., object]) -> None:
    selection = assessed(make_case(), [[0, 0, 0, 0], [0, 0.6, 0, 0]], [100.0, 100.0])
    assert not selection.ambiguous
    assert selection.second is None
    assert selection.covariance[1, 1] == pytest.approx(0.01 + 0.6**2 / 2, rel=1e-4)  # half of the mass is 0.6 m away


@pytest.mark.parametrize(
    ("information", "reason"),
    [
        (np.diag([1.0, 1e2, 1e2, 1e2]), "the relative heading is not observable (standard deviation 57 degrees)"),
        (np.diag([1e4, 1e-4, 1e2, 1e2]), "the relative position is too vague to prune (standard deviation"),
    ],
)
def test_vague_peaks_are_not_used(information: FloatArray, reason: str, make_case: Callable[..., object]) -> None:
    selection = assessed(make_case(), [[0, 0, 0, 0]], [100.0], information)
    assert selection.ambiguous
    assert reason in selection.reason


def test_two_measurements_are_too_little(make_case: Callable[..., object]) -> None:
    """Two bearings and two ranges: four numbers, of which three fix the alignment, and 1.5 more are asked for."""
    selection = assessed(make_case(heard=2), [[0, 0, 0, 0]], [100.0])
    assert selection.ambiguous
    assert "too little was measured: 4.0 independent ranges and bearings agree where 3 fix" in selection.reason


def test_agreement_that_chance_would_bring_is_not_believed(make_case: Callable[..., object]) -> None:
    selection = assessed(make_case(), [[0, 0, 0, 0]], [0.0])
    assert selection.ambiguous
    assert selection.reason == "the measurements agree no better than chance would have it"


def test_evidence_is_the_integral_of_a_gaussian() -> None:
    information = np.stack([np.diag([1.0, 2.0, 3.0, 4.0]), np.diag([2.0, 2.0, 3.0, 4.0])])
    evidence = log_evidence(Peaks(np.zeros((2, 4)), np.array([5.0, 5.0]), information))
    assert evidence[0] - evidence[1] == pytest.approx(0.5 * np.log(2.0), abs=1e-6)  # twice as wide in variance
