"""Three robots judge each other: a third one refutes readings that two robots' measurements cannot tell apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wiclosure import se3
from wiclosure.types import FrameAlignment, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.filter import WiClosureFilter

from .test_whole_log import STEPS, Trajectory, drive, heard

STAMPS_NS = np.arange(STEPS, dtype=np.int64) * 10**9
# b and c drive in parallel, and see the same under many blunders; a drives in a curve.
ROBOTS = {
    "a": Trajectory("a", STAMPS_NS, drive(-0.09, (12.0, 26.0))),
    "b": Trajectory("b", STAMPS_NS, drive(0.0, (0.0, 0.0))),
    "c": Trajectory("c", STAMPS_NS, drive(0.0, (0.0, 8.0))),
}
BY_A = [*heard(ROBOTS["a"], ROBOTS["b"], reverse=False), *heard(ROBOTS["a"], ROBOTS["c"], reverse=False)]


def alignments(measurements: list[WirelessMeasurement]) -> dict[tuple[str, str], FrameAlignment]:
    result = WiClosureFilter().candidates(ROBOTS, WirelessLog(tuple(measurements)))
    return {(one.robot_a, one.robot_b): one for one in result.alignments}


def test_a_reading_that_does_not_close_the_cycle_is_refuted() -> None:
    """Only b has heard c, with an antenna array that nobody else vouches for."""
    alone = alignments(heard(ROBOTS["b"], ROBOTS["c"], reverse=False))["b", "c"]
    assert alone.ambiguous
    assert alone.only_blunders
    found = alignments(BY_A + heard(ROBOTS["b"], ROBOTS["c"], reverse=False))
    assert not any(one.ambiguous for one in found.values())
    assert "a rules out that the log is wrong" in found["b", "c"].reason
    true = se3.between(ROBOTS["b"].poses[20], ROBOTS["c"].poses[20])
    best = found["b", "c"].best
    assert best is not None
    said = se3.inverse(ROBOTS["b"].poses[20]) @ best.T_a_b @ ROBOTS["c"].poses[20]
    assert np.linalg.norm(said[:2, 3] - true[:2, 3]) < 1.0


def test_a_claim_that_does_not_close_it_stays_doubted() -> None:
    """b's azimuths are reversed, and fit as well: by a's measurements c lies on b's other side."""
    found = alignments(BY_A + heard(ROBOTS["b"], ROBOTS["c"], reverse=True))
    assert found["b", "c"].ambiguous


def test_a_doubted_witness_does_not_count() -> None:
    noise = np.random.default_rng(0)
    blurred = [replace(m, range_m=float(noise.uniform(5.0, 60.0)), paths=()) for m in BY_A]
    found = alignments(blurred + heard(ROBOTS["b"], ROBOTS["c"], reverse=False))
    assert found["b", "c"].ambiguous
