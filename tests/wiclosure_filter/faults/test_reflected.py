"""What one pair of robots tells of a wall counts for the rest of the team, unless they refute it."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.types import FrameAlignment
from wiclosure.wiclosure_filter.config import AmbiguitySettings
from wiclosure.wiclosure_filter.faults.corrections import Correction
from wiclosure.wiclosure_filter.faults.reflected import reflections_in_doubt

GUARD = AmbiguitySettings()


def certain(a: str, b: str, log_image: float) -> dict[tuple[str, str], FrameAlignment]:
    return {(a, b): FrameAlignment(a, b, None, None, False, "made for a test", log_image=log_image)}


def y_right(robot: str, *pairs: tuple[str, str]) -> dict[tuple[str, str], Correction]:
    fault = Correction(f"odometry of {robot} has y to the right", lambda inputs: inputs, mirrored=True)
    return dict.fromkeys(pairs, fault)


@pytest.mark.parametrize(("log_image", "doubted"), [(1.0, True), (-2.0, True), (-8.0, False), (-np.inf, False)])
def test_two_pairs_that_heard_images_put_the_third_in_doubt_unless_it_refutes_one(
    log_image: float, doubted: bool
) -> None:
    found = reflections_in_doubt(certain("a", "b", log_image), y_right("c", ("a", "c"), ("b", "c")), GUARD)
    assert bool(found) == doubted
    assert all("a and c, b and c measured what images in a wall would show" in told for told in found.values())


def test_where_nobody_heard_an_image_nothing_is_in_doubt() -> None:
    clock = {("a", "c"): Correction("clocks apart", lambda inputs: inputs)}
    assert reflections_in_doubt(certain("a", "b", 0.0), clock, GUARD) == {}


def test_whoever_trusts_the_log_trusts_it_here() -> None:
    guard = GUARD.model_copy(update={"weigh_blunders": False})
    assert reflections_in_doubt(certain("a", "b", 0.0), y_right("c", ("a", "c")), guard) == {}


def test_in_a_fleet_that_refutes_images_it_is_the_odometry_of_one_robot() -> None:
    robots = [f"r{k}" for k in range(8)]
    alignments = certain("a", "b", 0.0)
    for one in robots:
        for other in robots:
            alignments |= certain(one, other, -20.0) if one < other else {}
    faults = y_right("c", *((robot, "c") for robot in (*robots, "a", "b")))
    assert reflections_in_doubt(alignments, faults, GUARD) == {}


def test_what_prunes_nothing_needs_no_further_doubt() -> None:
    ((pair, alignment),) = certain("a", "b", 0.0).items()
    assert reflections_in_doubt({pair: alignment.doubted("a slip")}, y_right("c", ("a", "c")), GUARD) == {}
