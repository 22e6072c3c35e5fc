"""What a candidate filter finds: kept pairs, how the frames lie, and the radio links that it takes for true."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from wiclosure import se3
from wiclosure.arrays import BoolArray, FloatArray, IntArray
from wiclosure.candidates import CandidatePairs
from wiclosure.display import data_frame, html_table, plot_kept_pairs

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


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


_BLUNDER = 10.0  # times the usual size of a constant error


@dataclass(frozen=True, slots=True)
class Calibration:
    """A systematic error that was estimated along with an alignment, and that its predictions are corrected for.

    Args:
        name: what it is.
        unit: `m`, `s`, `rad`, or empty for a ratio.
        value, sigma: the estimate; sigma is that of the prior where the measurements do not tell.
        prior_sigma: standard deviation that was expected.
        held_sigma: that of the Gaussian which stood for the prior: wider where a blunder is likely, or nothing tells.
    """

    name: str
    unit: str
    value: float
    sigma: float
    prior_sigma: float
    held_sigma: float

    @property
    def extraordinary(self) -> bool:
        """Whether it is clearly there, and beyond what is ordinary: a fault."""
        return abs(self.value) > 3 * max(self.sigma, self.prior_sigma)

    @property
    def blunder_sigma(self) -> float:
        """Standard deviation of an error that is a blunder."""
        return _BLUNDER * self.prior_sigma

    @property
    def log_blunder(self) -> float:
        """Natural logarithm of the Bayes factor for an error of a blunder's size, ten times the usual, against that.

        Zero where the prior hardly draws the estimate from what was measured: then the estimate has followed.
        """
        value, sigma = self.measured
        if abs(value - self.value) <= self.sigma:
            return 0.0
        usual, blunder = sigma**2 + self.prior_sigma**2, sigma**2 + self.blunder_sigma**2
        return math.log(usual / blunder) / 2 + value**2 / 2 * (1 / usual - 1 / blunder)

    @property
    def measured(self) -> tuple[float, float]:
        """Value and sigma by the measurements alone, without the prior that draws the estimate to zero."""
        told = max(1.0 - (self.sigma / self.held_sigma) ** 2, 1e-6)
        return self.value / told, self.sigma / math.sqrt(told)

    @property
    def as_blunder(self) -> float:
        """The estimate if the error is of a blunder's size: the measurements then tell nearly all of it."""
        value, sigma = self.measured
        return value / (1 + (sigma / self.blunder_sigma) ** 2)

    @property
    def told(self) -> bool:
        """Whether the measurements tell it at all: better than within ten times its usual size."""
        return self.measured[1] < self.blunder_sigma

    def __str__(self) -> str:
        (value, sigma), unit = self.measured, self.unit
        if not self.told:
            return f"{self.name}: not told by the measurements"
        if unit in {"rad", ""}:
            factor, unit = (180 / math.pi, "degrees") if unit else (100.0, "%")
            value, sigma = factor * value, factor * sigma
        return f"{self.name}: {value:.2f} {unit}, sigma {sigma:.2f}"


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


@dataclass(frozen=True, slots=True, eq=False)
class RadioLinks:
    """What two robots measured of each other and a filter takes for true, ready for a pose graph.

    Args:
        robot_a, robot_b: the robots.
        T_a_b: `(4, 4)` odometry frame of b in that of a, roughly.
        level: `(6, 6)` covariance of what is known of `T_a_b` without these measurements: gravity, and the ground.
        index_a, index_b: `(L,)` keyframes nearest in time.
        antenna_a, antenna_b: `(L, 3)` m, antennas when they measured, in the body axes of these keyframes.
        a_receives: `(L,)` whether a measured b's signal.
        range_m, range_sigma_m: `(L,)`; NaN where nothing was ranged.
        direction: `(L, 3)` unit vector to the transmitter, in the body axes of the receiver's keyframe; NaN where the
            direct path is not known.
        direction_covariance: `(L, 3, 3)` of the direction, on the tangent plane, rad^2.
    """

    robot_a: str
    robot_b: str
    T_a_b: FloatArray
    level: FloatArray
    index_a: IntArray
    index_b: IntArray
    antenna_a: FloatArray
    antenna_b: FloatArray
    a_receives: BoolArray
    range_m: FloatArray
    range_sigma_m: FloatArray
    direction: FloatArray
    direction_covariance: FloatArray

    def __repr__(self) -> str:
        return f"RadioLinks({self.robot_a!r} and {self.robot_b!r}, {len(self)} links)"

    def __len__(self) -> int:
        return len(self.range_m)


class ClosureCheck(Protocol):
    """Holds measured closures of two robots against what a filter knows of them."""

    def objections(
        self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray
    ) -> tuple[str, ...]:
        """Why each of N closures cannot be, as a sentence; empty where nothing speaks against it.

        Args:
            T_a_b: `(N, 4, 4)` measured poses of keyframes of b in those of a.
            covariance: `(N, 6, 6)` their covariances.
            index_a: `(N,)` keyframes of a.
            index_b: `(N,)` those of b.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class FilterResult:
    """What a candidate filter gives to the pipeline.

    Args:
        filter_name: registry name of the filter.
        pairs: kept pairs, one entry for each pair of robots (also when empty).
        pairs_total: how many pairs of keyframes there are between different robots.
        alignments: one for each pair of robots of which the radio tells anything.
        diagnosis: sentences for the user: which pairs were kept, rejected or left out, and why.
        seconds: wall time spent.
        links: measurements that the kept pairs rest on, for the pose graph.
        checks: what measured closures of robots `(robot_a, robot_b)` can be held against where nothing is predicted for
            certain; queries are of robot_a.
    """

    filter_name: str
    pairs: tuple[CandidatePairs, ...]
    pairs_total: int
    alignments: tuple[FrameAlignment, ...] = ()
    diagnosis: tuple[str, ...] = ()
    seconds: float = 0.0
    links: tuple[RadioLinks, ...] = ()
    checks: Mapping[tuple[str, str], ClosureCheck] = field(default_factory=dict)

    def __repr__(self) -> str:
        kept = f"{self.pairs_kept} of {self.pairs_total} pairs kept"
        ambiguous = sum(alignment.ambiguous for alignment in self.alignments)
        aligned = f"{len(self.alignments) - ambiguous} of {len(self.alignments)} alignments certain"
        return f"FilterResult({self.filter_name!r}, {kept}, {aligned}, {self.seconds:.2f} s)"

    @property
    def pairs_kept(self) -> int:
        """How many pairs were kept."""
        return sum(len(p) for p in self.pairs)

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        rows = [("candidate pairs", f"{self.pairs_kept:,} of {self.pairs_total:,} kept")]
        for found in self.alignments:
            verdict = "ambiguous" if found.ambiguous else "certain"
            rows.append((f"{found.robot_a} and {found.robot_b}", f"alignment {verdict}: {found.reason}"))
        rows += [("remark", sentence) for sentence in self.diagnosis]
        return html_table(f"filter {self.filter_name}", [*rows, ("seconds", f"{self.seconds:.2f}")])

    def plot(self) -> Figure:
        """Kept pairs of each two robots, as a matplotlib figure."""
        return plot_kept_pairs(self.pairs)

    def to_dataframe(self) -> pd.DataFrame:
        """Kept pairs, one row each: `robot_a`, `index_a`, `robot_b`, `index_b`, `mahalanobis`, `overlap_probability`.

        Raises:
            ConfigError: pandas is not installed.
        """
        columns: dict[str, list[Any]] = {
            name: [robot for pairs in self.pairs for robot in [getattr(pairs, name)] * len(pairs)]
            for name in ("robot_a", "robot_b")
        } | {
            name: [value for pairs in self.pairs for value in getattr(pairs, name).tolist()]
            for name in ("index_a", "index_b", "mahalanobis", "overlap_probability")
        }
        order = ("robot_a", "index_a", "robot_b", "index_b", "mahalanobis", "overlap_probability")
        return data_frame({name: columns[name] for name in order})
