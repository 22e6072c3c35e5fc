"""A radio check that refuses more closures than it leaves: the few that are left, against sets of the refused ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.odds import Verdict
from wiclosure.pipeline.mutual_check.pair_check import PairOutcome
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio
from wiclosure.pipeline.mutual_check.refused import weigh_refused
from wiclosure.types import CandidatePairs, Closure, Stage, Trajectory, WirelessLog
from wiclosure.wiclosure_filter.config import AlignmentSettings

from .rivals.test_sets import closures, log, team

__all__ = ["log", "team"]  # fixtures


def outcome(left: Sequence[Closure], refused: Sequence[Closure]) -> PairOutcome:
    """Registered closures of which the radio check left some."""
    kept = CandidatePairs.without_prediction("a", "b", np.zeros(0, np.int64), np.zeros(0, np.int64))
    checked = [c.accepted(Stage.RADIO_CHECK) for c in left] + [c.rejected(Stage.RADIO_CHECK, "no") for c in refused]
    return PairOutcome(("a", "b"), kept, (*left, *refused), tuple(checked))


@pytest.fixture
def radio(team: dict[str, Trajectory], log: WirelessLog) -> PairRadio:
    return PairRadio.of(("a", "b"), team, log, AlignmentSettings())


def test_refused_closures_that_the_log_fits_better_win(team: dict[str, Trajectory], radio: PairRadio) -> None:
    found = weigh_refused(outcome(closures(team, "look alike", 5), closures(team, "true", 11)), radio, Config())
    assert found is not None
    assert found.weighed is not None
    assert found.weighed.verdict is Verdict.COMPATIBLE
    assert found.drops_radio
    assert found.found.startswith("11 closures")


def test_closures_that_the_log_fits_stay_however_many_are_refused(
    team: dict[str, Trajectory], radio: PairRadio
) -> None:
    assert weigh_refused(outcome(closures(team, "true", 5), closures(team, "look alike", 11)), radio, Config()) is None


def test_nothing_is_weighed_where_most_closures_are_left(team: dict[str, Trajectory], radio: PairRadio) -> None:
    assert weigh_refused(outcome(closures(team, "look alike", 11), closures(team, "true", 5)), radio, Config()) is None


def test_a_log_that_tells_nothing_leaves_it_open(team: dict[str, Trajectory], radio: PairRadio) -> None:
    vague = WirelessLog(tuple(replace(m, paths=(), range_sigma_m=200.0) for m in radio.log.measurements[:2]))
    mute = PairRadio.of(("a", "b"), team, vague, AlignmentSettings())
    found = weigh_refused(outcome(closures(team, "look alike", 10), closures(team, "true", 11)), mute, Config())
    assert found is not None
    assert found.doubts
    assert found.drops_radio
