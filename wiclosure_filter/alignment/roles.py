"""Which of two robots is the reference of their alignment: what they did says so, not who is named first.

A chain of frame transforms is stated in the axes of one robot, a different alignment is one that puts the other robot
elsewhere, and clocks that differ move the other robot along its path.  So an alignment near a limit may be certain with
one robot as the reference and not with the other.  The reference is the robot that received more, since its clock gave
the measurements their stamps; of two that received as many, the one that moved less, since an error of the yaw between
them then shows as a shift of the other one's path.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, FloatArray, FrameAlignment, IntArray
from wiclosure.wiclosure_filter.drift.calibration import exchanged
from wiclosure.wiclosure_filter.links.links import Links


def with_reference_first(links: Links) -> Links:
    """The links with the reference as robot a; of robots that moved as far, the one that received first."""
    if len(links) == 0:
        return links
    by_a, moved_a, moved_b = int(links.a_receives.sum()), _spread_m2(links.antenna_a), _spread_m2(links.antenna_b)
    by_b = len(links) - by_a
    stays = (by_a, -moved_a, links.a_receives[0]) > (by_b, -moved_b, not links.a_receives[0])
    return links if stays else links.exchanged()


def as_named(alignment: FrameAlignment, links: Links) -> FrameAlignment:
    """An alignment with the robots in the order in which the links name them."""
    if alignment.robot_a == links.robot_a:
        return alignment
    restated = replace(
        alignment,
        robot_a=links.robot_a,
        robot_b=links.robot_b,
        best=None if alignment.best is None else _inverse(alignment.best),
        best_alternative=None if alignment.best_alternative is None else _inverse(alignment.best_alternative),
        likely_alternatives=tuple(map(_inverse, alignment.likely_alternatives)),
    )
    if alignment.best is not None and alignment.covariance is not None:
        covariance = se3.inverse_covariance(alignment.best.T_a_b, alignment.covariance)
        restated = replace(restated, covariance=covariance)
    if alignment.calibration_covariance is not None:
        names = links.robot_a, links.robot_b
        calibration, errors = exchanged(alignment.calibration, alignment.calibration_covariance, *names)
        restated = replace(restated, calibration=calibration, calibration_covariance=errors)
    if alignment.fit is not None:
        restated = replace(restated, fit=replace(alignment.fit, starts_ns=_at_a(alignment.fit.starts_ns, links)))
    if alignment.bent_ns is not None:
        since_ns, until_ns = _at_a(np.array(alignment.bent_ns), links).tolist()
        restated = replace(restated, bent_ns=(since_ns, until_ns))
    return restated


def _spread_m2(antenna: FloatArray) -> float:
    """Mean square distance of positions `(M, 3)` from their centre, horizontally."""
    return float(np.square(antenna - antenna.mean(axis=0))[:, :2].sum(axis=1).mean())


def _inverse(hypothesis: AlignmentHypothesis) -> AlignmentHypothesis:
    return replace(hypothesis, T_a_b=se3.inverse(hypothesis.T_a_b))


def _at_a(stamps_ns: IntArray, links: Links) -> IntArray:
    """Times at b as the measurements before them have them at a."""
    order = np.argsort(links.stamp_b_ns, kind="stable")
    before = np.searchsorted(links.stamp_b_ns[order], stamps_ns, side="right") - 1
    rows = order[np.maximum(before, 0)]
    return np.asarray(stamps_ns + links.stamp_a_ns[rows] - links.stamp_b_ns[rows])
