"""Verdicts where the evidence of either side is given."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.pipeline.config import MutualCheckSettings
from wiclosure.pipeline.mutual_check.odds import Agreement, Verdict, Weighed, agrees_with_radio, weigh
from wiclosure.pipeline.mutual_check.radio_evidence import Explained

CHOSEN = 12.0  # yaw within 0.1 rad and a place within a metre, of a circle of 100 m
NONE = Agreement(0, 0, 0.0)
SOLID = Agreement(12, 0, 3.0)
LOOK_ALIKE = Agreement(6, 14, 1.0)


def claimed(implied: float, free: float) -> Explained:
    return Explained("", implied, free, CHOSEN)


def weighed(
    as_claimed: Explained,
    *errors: tuple[float, float],
    closures: Agreement = SOLID,
    predicted: Agreement = NONE,
    refuted: float = 0.0,
) -> Weighed:
    read = [Explained(f"error {number}", *found, CHOSEN) for number, found in enumerate(errors)]
    return weigh(as_claimed, read, closures, predicted, refuted, MutualCheckSettings())


def test_radio_that_fits_wins_over_closures_of_a_place_that_looks_like_another() -> None:
    found = weighed(claimed(-20.0, 80.0), (-15.0, 60.0), closures=LOOK_ALIKE)
    assert found.verdict is Verdict.RADIO
    assert found.cause == ""


def test_radio_with_closures_of_its_own_wins_over_a_solid_set() -> None:
    own = Agreement(10, 0, 3.0)
    assert weighed(claimed(-20.0, 80.0), (-15.0, 60.0), predicted=own).verdict is Verdict.RADIO


def test_closures_win_where_one_error_explains_the_log() -> None:
    found = weighed(claimed(-20.0, 60.0), (-15.0, 50.0), (65.0, -np.inf), closures=LOOK_ALIKE)
    assert found.verdict is Verdict.CLOSURES
    assert found.cause == "error 1"


def test_closures_win_where_the_log_allows_them_as_well() -> None:
    assert weighed(claimed(50.0, 56.0), (40.0, 56.0)).verdict is Verdict.COMPATIBLE


def test_closures_win_where_registration_refutes_the_predictions_and_nothing_explains_the_log() -> None:
    """An error that nobody has thought of, against twelve closures of three places."""
    found = weighed(claimed(-20.0, 60.0), (-15.0, 50.0), refuted=3.0)
    assert found.verdict is Verdict.CLOSURES
    assert "none of the known" in found.cause


def test_neither_is_believed_where_the_log_put_right_contradicts_the_closures() -> None:
    """As with reversed azimuths in a town whose blocks look alike: the ranges refute the closures."""
    found = weighed(claimed(-25.0, 2.0), (-22.0, 45.0), closures=LOOK_ALIKE)
    assert found.verdict is Verdict.NEITHER
    assert found.cause == "error 0"


def test_two_weak_sides_are_left_undecided() -> None:
    found = weighed(claimed(-9.0, 8.0), (-8.0, 7.0), closures=Agreement(3, 2, 1.0))
    assert found.verdict is Verdict.UNDECIDED
    assert found.log_odds < np.log(MutualCheckSettings().decisive_odds)
    assert found.cause


def test_more_registrations_that_contradict_the_rest_make_closures_less_likely() -> None:
    chances = [Agreement(10, others, 2.0).log_look_alike for others in range(20)]
    assert all(np.diff(chances) > 0)
    assert chances[0] == pytest.approx(2 * np.log(0.5 / 11))
    assert NONE.log_look_alike == 0


def test_more_places_make_closures_likelier_up_to_three() -> None:
    chances = [Agreement(10, 1, places).log_look_alike for places in (1.0, 2.0, 3.0, 9.0)]
    assert chances[0] > chances[1] > chances[2] == chances[3]


@pytest.mark.parametrize(("implied", "free", "agrees"), [(30.0, 32.0, True), (30.0, 50.0, False), (2.0, 3.0, False)])
def test_agreement_with_a_log_is_more_than_chance_and_no_less_than_its_own(
    implied: float, free: float, agrees: bool
) -> None:
    assert agrees_with_radio(claimed(implied, free)) is agrees
