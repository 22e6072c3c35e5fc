"""What is weighed of a set of closures."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.config import MutualCheckSettings
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio
from wiclosure.pipeline.mutual_check.set_evidence import SetEvidence, places
from wiclosure.types import Closure, KeyframeId, Stage, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings

S = 10**9
PATHS = {
    robot: Trajectory(robot, np.arange(60) * S, se3.from_yaw(0 * x, np.column_stack([x, y, 0 * x])))
    for robot, x, y in (
        ("a", np.arange(60.0), 10 * np.sin(np.arange(60) / 9)),
        ("b", np.arange(60.0)[::-1] + 5.0, 12 * np.cos(np.arange(60) / 7)),
    )
}


def between(i: int, j: int) -> Closure:
    T = se3.between(PATHS["a"].poses[i], PATHS["b"].poses[j])
    return Closure.from_measurement(KeyframeId("a", i), KeyframeId("b", j), T, np.eye(6) * 1e-4)


def test_places_count_how_far_closures_reach_on_the_shorter_path() -> None:
    assert places([]) == 0
    assert places([between(3, 3)]) == 1
    assert places([between(3, 3), between(33, 8)]) == pytest.approx(1.5)


def test_a_set_is_likelier_the_more_others_it_shows_to_be_false_and_where_the_log_fits() -> None:
    distance_m = np.linalg.norm(PATHS["a"].positions - PATHS["b"].positions, axis=1)
    log = WirelessLog(tuple(WirelessMeasurement(i * S, "a", "b", float(distance_m[i]), 0.3) for i in range(0, 60, 5)))
    radio = PairRadio.of(("a", "b"), PATHS, log, AlignmentSettings())
    true, settings = [between(i, 58 - i) for i in (5, 20, 35, 50)], MutualCheckSettings()
    elsewhere = [
        Closure.from_measurement(c.query, c.match, se3.from_yaw(0.0, np.array([20.0, 20.0, 0.0])), np.eye(6) * 1e-4)
        for c in true
    ]

    def score(closures: list[Closure], others: int) -> float:
        evidence = SetEvidence.of(closures, others, radio)
        return float(np.logaddexp.reduce(list(evidence.if_right(evidence.errors(search=False), settings).values())))

    assert score(true, 0) > score(true, 4)
    assert score(true, 4) > score(elsewhere, 4) + np.log(settings.decisive_odds)


def test_a_set_that_has_keyframes_near_which_registered_elsewhere_is_less_likely() -> None:
    radio = PairRadio.of(("a", "b"), PATHS, WirelessLog(), AlignmentSettings())
    here = [between(i, 58 - i) for i in (5, 20, 35, 50)]
    apart_m = [float(np.linalg.norm(PATHS["a"].positions[i] - PATHS["b"].positions[64 - i])) for i in range(8, 60)]
    near = [between(i + 8, 56 - i) for i, metres in enumerate(apart_m) if metres < 4.0]
    elsewhere = [c.rejected(Stage.RADIO_CHECK, "lies elsewhere") for c in near]
    missed = [SetEvidence.of(here, 0, radio, [*here, *elsewhere[:n]]).log_missed for n in (0, 2, len(elsewhere))]
    assert missed[0] == 0
    assert missed[2] < missed[1] <= 0
    assert missed[2] == pytest.approx(3 * np.log(0.3))  # no more than three places count
