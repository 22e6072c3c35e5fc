"""A blunder is named, nothing is certain because of it, and accepting its correction puts all right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import AoaPath, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.faults.cycles import Cycles
from wiclosure.wiclosure_filter.filter import WiClosureFilter

SECOND_NS = 10**9


def team(names: str) -> tuple[dict[str, Trajectory], dict[str, np.ndarray]]:
    """Robots that wind about each other, and their true poses."""
    rng, truth, odometry = np.random.default_rng(3), {}, {}
    for name in names:
        yaw = rng.uniform(-3, 3) + np.cumsum(rng.normal(0, 0.35, 80))
        steps = np.column_stack([np.cos(yaw), np.sin(yaw), 0 * yaw])
        truth[name] = se3.from_yaw(yaw, np.cumsum(steps, axis=0) + rng.uniform(-8, 8, 3) * [1, 1, 0])
        frame = se3.from_yaw(rng.uniform(-3, 3), rng.uniform(-20, 20, 3) * [1, 1, 0])
        odometry[name] = Trajectory(name, np.arange(80, dtype=np.int64) * SECOND_NS, se3.inverse(frame) @ truth[name])
    return odometry, truth


def heard(truth: dict[str, np.ndarray]) -> WirelessLog:
    rng, names, measurements = np.random.default_rng(4), list(truth), []
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            for k in range(0, 80, 3):
                seen = se3.between(truth[a][k], truth[b][k])[:3, 3]
                azimuth = float(np.arctan2(seen[1], seen[0]) + rng.normal(0, 0.1))
                ranged = abs(float(np.linalg.norm(seen) + rng.normal(0, 0.2)))
                paths = (AoaPath(float(se3.wrap_angle(np.asarray(azimuth))), 0.1), AoaPath(rng.uniform(-3, 3), 0.1))
                measurements.append(WirelessMeasurement(k * SECOND_NS, a, b, ranged, 0.2, paths))
    return WirelessLog(tuple(sorted(measurements, key=lambda m: m.stamp_ns)))


def azimuths(change: Callable[[float], float]) -> Callable[[WirelessMeasurement], WirelessMeasurement]:
    return lambda m: replace(
        m,
        paths=tuple(replace(p, azimuth=float(se3.wrap_angle(np.asarray(change(p.azimuth))))) for p in m.paths),
    )


FAULTS = {
    "clockwise": azimuths(lambda x: -x),
    "from the left": azimuths(lambda x: x - np.pi / 2),
    "reversed": azimuths(lambda x: x + np.pi),
    "feet": lambda m: replace(m, range_m=m.range_m / 0.3048),
    "swapped": lambda m: replace(m, receiver=m.transmitter, transmitter=m.receiver),
}


def test_an_honest_log_is_certain() -> None:
    odometry, truth = team("ab")
    (alignment,) = WiClosureFilter().candidates(odometry, heard(truth)).alignments
    assert not alignment.ambiguous
    assert not alignment.suspected_fault


def test_a_blunder_is_named_and_nothing_certain() -> None:
    odometry, truth = team("ab")
    log = WirelessLog(tuple(map(FAULTS["clockwise"], heard(truth).measurements)))
    result = WiClosureFilter().candidates(odometry, log)
    (alignment,) = result.alignments
    assert alignment.ambiguous
    assert "clockwise" in alignment.suspected_fault
    assert "--accept-correction" in " ".join(result.diagnosis)


@pytest.mark.parametrize("kind", ["azimuths", "ranges"])
def test_what_means_nothing_is_named_and_left_out(kind: str) -> None:
    """Degrees that a driver wrapped into one turn, and squares of ranges."""
    spoil = {
        "azimuths": azimuths(np.degrees),
        "ranges": lambda m: replace(m, range_m=m.range_m**2 / 5),
    }[kind]
    odometry, truth = team("ab")
    log = WirelessLog(tuple(map(spoil, heard(truth).measurements)))
    (said,) = WiClosureFilter().candidates(odometry, log).diagnosis
    assert f"{kind} contradict" in said
    (corrected,) = WiClosureFilter(FilterSettings(accept_correction=True)).candidates(odometry, log).alignments
    assert corrected.corrections
    T_true = odometry["a"].poses[0] @ se3.inverse(truth["a"][0]) @ truth["b"][0] @ se3.inverse(odometry["b"].poses[0])
    assert np.linalg.norm((corrected.best.T_a_b - T_true)[:2, 3]) < 3.0


@pytest.mark.parametrize("name", FAULTS)
def test_a_blunder_can_be_corrected(name: str) -> None:
    odometry, truth = team("ab")
    log = WirelessLog(tuple(map(FAULTS[name], heard(truth).measurements)))
    (accepted,) = WiClosureFilter(FilterSettings(accept_correction=True)).candidates(odometry, log).alignments
    assert not accepted.ambiguous
    assert name in accepted.corrections[0]
    true = odometry["a"].poses[0] @ se3.between(truth["a"][0], truth["b"][0]) @ se3.inverse(odometry["b"].poses[0])
    b = odometry["b"].positions
    assert np.linalg.norm(se3.transform(accepted.best.T_a_b, b) - se3.transform(true, b), axis=1).mean() < 1.5


def test_odometry_with_y_to_the_right_is_named_but_not_corrected() -> None:
    odometry, truth = team("ab")
    flip = np.diag([1.0, -1.0, 1.0, 1.0])
    mirrored = {**odometry, "b": replace(odometry["b"], poses=flip @ odometry["b"].poses @ flip)}
    (alignment,) = WiClosureFilter(FilterSettings(accept_correction=True)).candidates(mirrored, heard(truth)).alignments
    assert alignment.ambiguous
    assert "odometry of b seems to have y to the right" in alignment.suspected_fault
    assert not alignment.corrections


def test_alignments_around_a_cycle_must_add_up() -> None:
    odometry, truth = team("abc")
    chosen = WiClosureFilter()
    links = chosen.gather(odometry, heard(truth)).by_pair
    alignments = chosen.align(odometry, links)
    assert not any(alignment.ambiguous for alignment in alignments.values())
    assert Cycles(alignments, links, odometry, 1.5).contradictions() == {}
    best = alignments["a", "c"].best
    moved = replace(best, T_a_b=best.T_a_b @ se3.from_yaw(0.0, np.array([40.0, 0.0, 0.0])))
    wrong = {**alignments, ("a", "c"): replace(alignments["a", "c"], best=moved)}
    found = Cycles(wrong, links, odometry, 1.5).contradictions()
    assert set(found) == {("a", "b"), ("b", "c"), ("a", "c")}
    assert "contradict each other by 41 m" in found["a", "c"]


def test_names_of_three_that_are_mixed_up_are_found() -> None:
    odometry, truth = team("abc")
    names = {"a": "b", "b": "c", "c": "a"}
    log = WirelessLog(
        tuple(
            replace(m, receiver=names[m.receiver], transmitter=names[m.transmitter]) for m in heard(truth).measurements
        )
    )
    result = WiClosureFilter().candidates(odometry, log)
    assert all(alignment.ambiguous for alignment in result.alignments)
    assert any("names seem to be swapped" in alignment.suspected_fault for alignment in result.alignments)
