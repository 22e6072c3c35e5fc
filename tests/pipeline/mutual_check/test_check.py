"""Two robots whose closures and radio tell differently where they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.formats.radio.wireless_log import read_wireless_log
from wiclosure.formats.trajectories.tum import read_tum
from wiclosure.pipeline.config import Config, MutualCheckSettings
from wiclosure.pipeline.mutual_check.check import check_pair
from wiclosure.pipeline.mutual_check.odds import Verdict
from wiclosure.pipeline.mutual_check.pair_check import PairCheck, PairOutcome
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio
from wiclosure.pipeline.mutual_check.set_evidence import SetEvidence
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.types import (
    Closure,
    FloatArray,
    KeyframeId,
    Prediction,
    Stage,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)
from wiclosure.wiclosure_filter.baselines import NoFilter
from wiclosure.wiclosure_filter.filter import WiClosureFilter

SIGMA = np.repeat([0.005, 0.05], 3)
SHIFT = np.array([40.0, -25.0, 0.0])  # of the places that look alike


@dataclass(frozen=True, eq=False)
class Team:
    """Two robots on open ground: truth, odometry, and what they heard of each other."""

    truth: dict[str, Trajectory]
    odometry: dict[str, Trajectory]
    log: WirelessLog

    def closures(self, count: int, shift_m: FloatArray | None = None) -> list[Closure]:
        """Between places that are near each other, or would be if b's were shifted."""
        rng = np.random.default_rng(count)
        a, b = self.truth["a"].poses, self.truth["b"].poses.copy()
        b[:, :3, 3] += np.zeros(3) if shift_m is None else shift_m
        near = np.argwhere(np.linalg.norm(a[:, None, :3, 3] - b[None, :, :3, 3], axis=2) < 6.0)
        chosen = rng.permutation(near)[:count]
        assert len(chosen) == count
        return [
            registered(KeyframeId("a", int(i)), KeyframeId("b", int(j)), se3.between(a[i], b[j]), rng)
            for i, j in chosen
        ]

    def outcome(self, log: WirelessLog, keep: Callable[[Closure], bool] = lambda closure: True) -> PairOutcome:
        """What the filter predicts from a log; and closures at its predictions, those that `keep` says."""
        (kept,) = WiClosureFilter().candidates(self.odometry, log).pairs
        if kept.predictor is None or len(kept) == 0:
            return PairOutcome(("a", "b"), kept, (), ())
        rows = np.linspace(0, len(kept) - 1, 60).astype(int)
        predicted = kept.predicted(rows)
        assert predicted is not None
        found = []
        for row, T, covariance in zip(rows, *predicted, strict=True):
            ends = KeyframeId("a", int(kept.index_a[row])), KeyframeId("b", int(kept.index_b[row]))
            found.append(Closure(*ends, prediction=Prediction(T, covariance, kept.predictor.kind)))
        refused = tuple(c.rejected(Stage.REGISTRATION, "too little matches") for c in found)
        return PairOutcome(("a", "b"), kept, refused, refused)


def registered(query: KeyframeId, match: KeyframeId, T: FloatArray, rng: np.random.Generator) -> Closure:
    noisy = T @ se3.exp(rng.normal(size=6) * SIGMA)
    return Closure.from_measurement(query, match, noisy, np.diag(SIGMA**2))


def path(robot: str, corners: Sequence[tuple[float, float]], rng: np.random.Generator) -> tuple[Trajectory, Trajectory]:
    """Truth and drifting odometry of a robot that drives from corner to corner, a metre a second."""
    points = np.array(corners)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    s = np.arange(0.0, way[-1])
    x, y = (np.convolve(np.pad(np.interp(s, way, c), 3, mode="edge"), np.ones(7) / 7, "valid") for c in points.T)
    poses = se3.from_yaw(np.arctan2(np.gradient(y), np.gradient(x)), np.column_stack([x, y, np.zeros(len(s))]))
    steps = se3.between(poses[:-1], poses[1:])
    steps = steps @ se3.exp(rng.normal(size=(len(steps), 6)) * [0, 0, 0.003, 0.02, 0.02, 0])
    drifted = [np.eye(4)]
    for step in steps:
        drifted.append(drifted[-1] @ step)
    stamps_ns = 10**18 + np.arange(len(s)) * 10**9
    return Trajectory(robot, stamps_ns, poses), Trajectory(robot, stamps_ns, np.array(drifted))


@pytest.fixture(scope="module")
def team() -> Team:
    rng = np.random.default_rng(4)
    paths = {
        "a": path("a", [(0, 0), (60, 5), (70, 45), (15, 50), (5, 15)], rng),
        "b": path("b", [(75, 40), (25, 48), (2, 20), (40, 3), (66, 12)], rng),
    }
    truth, odometry = ({robot: both[n] for robot, both in paths.items()} for n in (0, 1))
    radio = RadioSettings(every_m=4.0, direction="one-way", paths=2)
    return Team(truth, odometry, simulate_wireless_from_poses(truth, radio, seed=2))


def each(log: WirelessLog, change: Callable[[WirelessMeasurement], WirelessMeasurement]) -> WirelessLog:
    return replace(log, measurements=tuple(map(change, log.measurements)))


def turned(log: WirelessLog, sign: int, degrees: float) -> WirelessLog:
    def change(azimuth: float) -> float:
        return float(se3.wrap_angle(np.array(sign * azimuth + np.radians(degrees))))

    return each(log, lambda m: replace(m, paths=tuple(replace(p, azimuth=change(p.azimuth)) for p in m.paths)))


def longer(log: WirelessLog, factor: float, metres: float) -> WirelessLog:
    return each(log, lambda m: m if m.range_m is None else replace(m, range_m=factor * m.range_m + metres))


def late(log: WirelessLog, seconds: float) -> WirelessLog:
    return each(log, lambda m: replace(m, transmitter_stamp_ns=m.stamp_ns + round(1e9 * seconds)))


def checks(team: Team, log: WirelessLog, blind: Sequence[Closure]) -> PairCheck:
    return check_pair(team.outcome(log), team.odometry, log, Config(), lambda pair, also: list(blind))


FAULTS = {
    "feet": (lambda log: longer(log, 3.28, 0.0), "in feet"),
    "3 m too long": (lambda log: longer(log, 1.0, 3.0), "m too long"),
    "clock": (lambda log: late(log, 4.0), "clock of b"),
    "clockwise": (lambda log: turned(log, -1, 0.0), "clockwise, not counter-clockwise"),
    "from the left": (lambda log: turned(log, 1, -90.0), "from the left axis"),
    "reversed": (lambda log: turned(log, 1, 180.0), "reversed"),
    "odometry axes": (lambda log: each(log, lambda m: replace(m, aoa_frame="odometry")), "in body axes"),
}


@pytest.fixture(scope="module")
def unpredicted(team: Team) -> PairOutcome:
    """All pairs, since the filter calls nothing certain, as it does of a log with a fault."""
    (everything,) = NoFilter().candidates(team.odometry, team.log).pairs
    return PairOutcome(("a", "b"), everything, (), ())


@pytest.mark.parametrize("fault", FAULTS)
def test_closures_win_over_a_radio_with_an_error_which_is_named(
    team: Team, unpredicted: PairOutcome, fault: str
) -> None:
    spoil, words = FAULTS[fault]
    log, outcome = spoil(team.log), replace(unpredicted, checked=tuple(team.closures(12)))
    found = check_pair(outcome, team.odometry, log, Config(), lambda pair, also: [])
    assert found.weighed is not None
    assert found.weighed.verdict is Verdict.CLOSURES
    assert found.drops_radio
    assert words in found.sentence
    assert "the radio is the likely fault" in found.sentence


TWO_FAULTS = [("from the left", "clock"), ("clockwise", "3 m too long"), ("feet", "reversed")]


def test_closures_of_a_street_win_over_a_radio_with_two_errors_at_once() -> None:
    """With one of the two undone the log tells another alignment, decisively: that is no evidence against closures."""
    rng = np.random.default_rng(4)
    ways = {"a": [(0.0, 0.0), (40.0, 2.0), (75.0, 12.0)], "b": [(20.0, 0.0), (40.0, 2.0), (75.0, 12.0), (90.0, 20.0)]}
    paths = {robot: [at_ten_times_the_speed(t) for t in path(robot, way, rng)] for robot, way in ways.items()}
    truth, odometry = ({robot: both[n] for robot, both in paths.items()} for n in (0, 1))
    radio = RadioSettings(every_m=4.0, direction="reciprocal", paths=5)
    street = Team(truth, odometry, simulate_wireless_from_poses(truth, radio, seed=2))
    log = late(turned(street.log, 1, -90.0), 2.0)
    true = sorted(street.closures(60), key=lambda c: abs(c.query.index - 20) + abs(c.match.index - 5))[:12]
    evidence = SetEvidence.of(true, 0, PairRadio.of(("a", "b"), odometry, log, Config().filter.alignment))
    errors = evidence.errors()
    assert evidence.weighed(errors, MutualCheckSettings()).verdict is Verdict.NEITHER
    found = evidence.weighed_twice(errors, MutualCheckSettings())
    assert found.verdict is Verdict.CLOSURES
    assert "the clock of b seems to be about 2 s behind; and azimuths" in found.cause


def at_ten_times_the_speed(trajectory: Trajectory) -> Trajectory:
    start_ns = trajectory.stamps_ns[0]
    return replace(trajectory, stamps_ns=start_ns + (trajectory.stamps_ns - start_ns) // 10)


@pytest.mark.parametrize(("one", "other"), TWO_FAULTS)
def test_closures_of_places_that_look_alike_do_not_win_whatever_two_errors_the_log_has(
    team: Team, unpredicted: PairOutcome, one: str, other: str
) -> None:
    log, false = FAULTS[other][0](FAULTS[one][0](team.log)), tuple(team.closures(25, SHIFT))
    found = check_pair(replace(unpredicted, checked=false), team.odometry, log, Config(), lambda pair, also: [])
    assert found.weighed is not None
    assert found.weighed.verdict not in {Verdict.CLOSURES, Verdict.COMPATIBLE}


@pytest.mark.parametrize("fault", ["clockwise", "odometry axes"])
def test_closures_of_places_that_look_alike_do_not_win_over_ranges(
    team: Team, unpredicted: PairOutcome, fault: str
) -> None:
    spoil, _ = FAULTS[fault]
    log, false = spoil(team.log), team.closures(25, SHIFT)
    outcome = replace(unpredicted, checked=tuple(false))
    found = check_pair(outcome, team.odometry, log, Config(), lambda pair, also: [])
    assert found.weighed is not None
    assert found.weighed.verdict in {Verdict.NEITHER, Verdict.UNDECIDED}
    assert not found.drops_radio
    assert found.lost == {(c.query, c.match) for c in false}
    assert "the radio" in found.sentence


def test_honest_radio_wins_over_places_that_look_alike(team: Team) -> None:
    outcome = team.outcome(team.log)
    assert outcome.kept.predictor is not None
    agreeing = tuple(c.accepted(Stage.RADIO_CHECK) for c in team.closures(2))
    false = team.closures(12, SHIFT)
    found = check_pair(replace(outcome, checked=agreeing), team.odometry, team.log, Config(), lambda pair, also: false)
    assert found.weighed is not None
    assert found.weighed.verdict is Verdict.RADIO
    assert not found.lost & {(c.query, c.match) for c in agreeing}
    assert "look alike" in found.sentence


def test_nothing_is_registered_again_where_closures_agree_with_an_honest_radio(team: Team) -> None:
    agreeing = tuple(c.accepted(Stage.RADIO_CHECK) for c in team.closures(5))
    outcome = replace(team.outcome(team.log), checked=agreeing)

    def never(pair: tuple[str, str], also: Sequence[Closure]) -> list[Closure]:
        raise AssertionError("second round")

    found = check_pair(outcome, team.odometry, team.log, Config(), never)
    assert (found.weighed, found.blind, found.sentence) == (None, (), "")


def test_closures_that_agree_with_the_predictions_after_all_are_taken(team: Team) -> None:
    true = team.closures(12)
    found = checks(team, team.log, true)
    assert found.weighed is None
    assert found.blind == tuple(true)


def test_a_set_that_chance_explains_is_no_evidence(team: Team) -> None:
    rng = np.random.default_rng(0)
    random = [
        registered(
            KeyframeId("a", 5 * n), KeyframeId("b", 7 * n), se3.from_yaw(rng.uniform(-3, 3), rng.normal(0, 5, 3)), rng
        )
        for n in range(12)
    ]
    found = checks(team, longer(team.log, 3.28, 0.0), random)
    assert (found.weighed, found.sentence) == (None, "")


def test_closures_of_a_street_win_over_ranges_that_a_longer_odometry_turns(data_dir: Path) -> None:
    """Ranges alone, 4 % shorter than the odometry: called certain, 7 degrees off, 12 closures refused."""
    case = data_dir.parent / "cases" / "14-range-only-street"
    if not case.is_dir():
        pytest.skip(f"{case} not found")
    odometry = {robot: read_tum(case / f"{robot}.tum", robot) for robot in ("alpha", "beta")}
    log = read_wireless_log(case / "radio.jsonl")
    T_alpha_beta = se3.from_yaw(np.radians(47.8), np.array([19.79, 9.71, -0.06]))
    poses, there = odometry["alpha"].poses, T_alpha_beta @ odometry["beta"].poses
    near = np.argwhere(np.linalg.norm(odometry["alpha"].positions[:, None] - there[None, :, :3, 3], axis=2) < 3.0)
    rng = np.random.default_rng(0)
    true = [
        registered(KeyframeId("alpha", i), KeyframeId("beta", j), se3.between(poses[i], there[j]), rng)
        for i, j in rng.permutation(near)[:12].tolist()
    ]
    (kept,) = WiClosureFilter().candidates(odometry, log).pairs
    found = check_pair(
        PairOutcome(("alpha", "beta"), kept, (), ()), odometry, log, Config(), lambda pair, also: list(true)
    )
    assert found.weighed is None or found.drops_radio
    if found.weighed is None:  # the filter calls nothing certain that contradicts them
        assert kept.predictor is None or set(found.blind) == set(true)
    else:
        assert "likely fault" in found.sentence
