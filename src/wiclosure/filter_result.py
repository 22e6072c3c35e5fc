"""What a candidate filter finds: kept pairs, how the frames lie, and the radio links that it takes for true."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from wiclosure.arrays import BoolArray, FloatArray, IntArray
from wiclosure.candidates import CandidatePairs
from wiclosure.display import data_frame, html_table, plot_kept_pairs
from wiclosure.frame_alignment import FrameAlignment

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


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
