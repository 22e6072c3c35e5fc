"""How the odometry frames of two robots lie, as far as the radio tells."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

from wiclosure import se3
from wiclosure.arrays import FloatArray, IntArray
from wiclosure.calibration import Calibration


@dataclass(frozen=True, slots=True, eq=False)
class AlignmentHypothesis:
    """One way in which two odometry frames may lie: transform, log-likelihood, and the paths it explains.

    Args:
        T_a_b: `(4, 4)`, odometry frame of b in that of a.
        log_likelihood: of all measurements between the robots under this transform.
        paths_kept: `(measurement, path)` indices into the wireless log's measurements; path -1 stands for a measurement
            whose range was used without a direction.
        blunder: what would have to be wrong with the log for it to hold, as a clause; empty where nothing would.
    """

    T_a_b: FloatArray
    log_likelihood: float
    paths_kept: tuple[tuple[int, int], ...]
    blunder: str = ""

    def __repr__(self) -> str:
        x, y, z = self.T_a_b[:3, 3]
        where = f"x {x:.2f} m, y {y:.2f} m, z {z:.2f} m, yaw {float(se3.yaw(self.T_a_b)):.3f} rad"
        return f"AlignmentHypothesis({where}, log-likelihood {self.log_likelihood:.1f}, {len(self.paths_kept)} paths)"


@dataclass(frozen=True, slots=True, eq=False)
class AlignmentFit:
    """How many measurements agree with an alignment, by time.

    Args:
        starts_ns: `(T,)` where each of T equal stretches of time begins, by the clock of robot_a.
        bearings, agreeing_bearings: `(T,)` measurements with directions, and those of which one is the predicted one.
        ranges, agreeing_ranges: `(T,)` the same of ranges, with those that obstacles may have lengthened.
        probability: that an honest radio agrees as little as this in all.
    """

    starts_ns: IntArray
    bearings: IntArray
    agreeing_bearings: IntArray
    ranges: IntArray
    agreeing_ranges: IntArray
    probability: float

    def __repr__(self) -> str:
        bearings = f"{self.agreeing_bearings.sum()} of {self.bearings.sum()} bearings"
        return f"AlignmentFit({bearings} and {self.agreeing_ranges.sum()} of {self.ranges.sum()} ranges agree)"


@dataclass(frozen=True, slots=True, eq=False)
class FrameAlignment:
    """What the radio tells of how two robots' odometry frames lie.

    Args:
        robot_a, robot_b: the robots.
        best: most likely alignment, or None where there is none.
        covariance: `(6, 6)` of `best.T_a_b`, or None.
        ambiguous: true where the alignment must not be used to prune.
        reason: one sentence that says why, or what carries the alignment.
        best_alternative: the best *different* alignment, or None.
        likely_alternatives: where the doubt is between a few clear alignments, those that are likely besides `best`.
        heading_knowledge: `heading`, `reciprocal`, `one-way`, `range-only` or `none`.
        fit: how many measurements agree.
        suspected_fault: what seems to be wrong with log or odometry, as a sentence, or an empty string.
        calibration, calibration_covariance: constant errors that were estimated along with it.
        corrections: faults of the log that were corrected.
        strain: sum of squares, in standard deviations, by which the measurements bend odometry and constant errors.
        strain_probability: that they bend them as far if both err as usual.
        bent_ns: between which times at a they bend it most, or tell another alignment; None where nothing tells.
        slipped: whether odometry slipped then, or a robot was moved: links before and after tell an alignment each.
        slipped_robot: which of the two it was, or an empty string where nothing tells.
        log_image: natural logarithm of how much likelier b's image in a wall makes what was measured than b; -inf
            where that was not weighed.
    """

    robot_a: str
    robot_b: str
    best: AlignmentHypothesis | None
    covariance: FloatArray | None
    ambiguous: bool
    reason: str
    best_alternative: AlignmentHypothesis | None = None
    heading_knowledge: str = "none"
    likely_alternatives: tuple[AlignmentHypothesis, ...] = ()
    fit: AlignmentFit | None = None
    suspected_fault: str = ""
    calibration: tuple[Calibration, ...] = ()
    calibration_covariance: FloatArray | None = None
    corrections: tuple[str, ...] = ()
    strain: float = 0.0
    strain_probability: float = 1.0
    bent_ns: tuple[int, int] | None = None
    slipped: bool = False
    slipped_robot: str = ""
    log_image: float = -inf

    @property
    def only_blunders(self) -> bool:
        """Whether all that speaks against it is that blunders would fit as well."""
        return bool(self.likely_alternatives) and all(other.blunder for other in self.likely_alternatives)

    @property
    def slip_ns(self) -> tuple[int, int] | None:
        """Between which times at a odometry slipped, or a robot was moved; None where it seems not to."""
        return self.bent_ns if self.slipped else None

    def doubted(self, fault: str) -> FrameAlignment:
        """The same as one that must not be used to prune, with what seems to be wrong."""
        return replace(self, ambiguous=True, reason=fault, likely_alternatives=(), suspected_fault=fault)

    def certain_after_all(self, because: str) -> FrameAlignment:
        """The same without its doubts, and why these are gone."""
        return replace(
            self,
            ambiguous=False,
            reason=because if self.fit is None else f"{self.fit!r}; {because}",
            likely_alternatives=(),
            best_alternative=None,
            suspected_fault="",
        )

    def __repr__(self) -> str:
        verdict = "ambiguous" if self.ambiguous else "certain"
        return f"FrameAlignment({self.robot_a!r} and {self.robot_b!r}, {verdict}: {self.reason})"
