"""What the back end found: trajectories in one world, and which closures carry them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.backends.factor_graph.earth_factors import Ground
from wiclosure.backends.factor_graph.factors import Keys
from wiclosure.display import closure_columns, data_frame, html_table, listed, plot_paths
from wiclosure.errors import InputError
from wiclosure.types import Closure, FloatArray, IntArray, KeyframeId, Stage, Trajectory, survivors

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class GraphResult:
    """The estimate over all robots.

    Args:
        trajectories: keyframe poses `T_world_body` by robot.
        T_world_odom: `(4, 4)` by robot: where its odometry frame lies, taken at its first keyframe.
        components: robots that accepted closures, or radio, connect. The world of the first component is the odometry
            frame of the first robot; every other component lies in the odometry frame of its own first robot.
        closures: in the order given, with the final decision and reason.
        diagnosis: sentences for the user.
        graph: odometry, accepted closures, radio and one anchor for each component.
        values: the estimate in GTSAM's form.
        sigma_scale: factor on the standard deviations in `graph`.
        ground: what is known of the Earth; the world of the robots in `ground.placed` is its local east, north, up.
    """

    trajectories: dict[str, Trajectory]
    T_world_odom: dict[str, FloatArray]
    components: tuple[tuple[str, ...], ...]
    closures: tuple[Closure, ...]
    diagnosis: tuple[str, ...]
    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    sigma_scale: float = 1.0
    ground: Ground = field(default_factory=Ground)

    def __repr__(self) -> str:
        joined = "; ".join(listed(component) for component in self.components)
        return f"GraphResult({joined}; {len(self.accepted)} of {len(self.closures)} closures accepted)"

    @property
    def unconnected(self) -> tuple[str, ...]:
        """Robots that do not lie in the first robot's frame."""
        return tuple(robot for component in self.components[1:] for robot in component)

    @property
    def accepted(self) -> tuple[Closure, ...]:
        """The closures in the estimate."""
        return tuple(survivors(self.closures, Stage.ESTIMATE))

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        rows = [("one map", listed(component)) for component in self.components]
        rows.append(("closures", f"{len(self.accepted)} of {len(self.closures)} accepted"))
        return html_table("pose graph", [*rows, *(("remark", sentence) for sentence in self.diagnosis)])

    def plot(self, background: FloatArray | None = None) -> Figure:
        """Paths and accepted closures from above, as a matplotlib figure; robots not connected have their own panels.

        Args:
            background: `(M, 3)` m, points to draw below, in the frame of the first component.
        """
        paths = {robot: path.positions for robot, path in self.trajectories.items()}
        drawn = [c for c in self.accepted if {c.query.robot, c.match.robot} <= set(self.components[0])]
        ends = [[paths[key.robot][key.index] for key in (c.query, c.match)] for c in drawn]
        shape = np.array(ends, float).reshape(-1, 2, 3)
        return plot_paths(paths, shape, apart=self.unconnected, background=background)

    def to_dataframe(self) -> pd.DataFrame:
        """Every closure, one row each, with its decision and reason; see `wiclosure.display.closure_columns`.

        Raises:
            ConfigError: pandas is not installed.
        """
        return data_frame(closure_columns(self.closures))

    def residuals(self, closures: Sequence[Closure]) -> FloatArray:
        """Tangent vectors `(N, 6)` from each closure's pose to the estimate; NaN where the robots are not connected."""
        found = np.full((len(closures), 6), np.nan)
        component = {robot: n for n, group in enumerate(self.components) for robot in group}
        known = [
            n
            for n, c in enumerate(closures)
            if component.get(c.query.robot, -1) == component.get(c.match.robot, -2)
            and np.isfinite(c.best_T_query_match).all()
        ]
        if known:
            ends = [(closures[n].query, closures[n].match) for n in known]
            query, match = (
                np.stack([self.trajectories[k.robot].poses[k.index] for k in end]) for end in zip(*ends, strict=True)
            )
            measured = np.stack([closures[n].best_T_query_match for n in known])
            found[known] = se3.log(se3.between(measured, se3.between(query, match)))
        return found

    @cached_property
    def _marginals(self) -> gtsam.Marginals:
        return gtsam.Marginals(self.graph, self.values)

    def covariances(self, robot: str, indices: Sequence[int] | IntArray) -> FloatArray:
        """Marginal covariances `(M, 6, 6)` of keyframe poses in the body's frame, given the component's anchor."""
        keys = Keys(tuple(self.trajectories))
        found = [self._marginals.marginalCovariance(keys(robot, int(i))) for i in indices]
        return self.sigma_scale**2 * np.array(found).reshape(-1, 6, 6)

    def relative_covariance(self, first: KeyframeId, second: KeyframeId) -> FloatArray:
        """Covariance `(6, 6)` of `T_first_second`, as an error in the second's frame; between robots or within one.

        Raises:
            InputError: no chain of closures connects the two robots.
        """
        if not any({first.robot, second.robot} <= set(component) for component in self.components):
            raise InputError(f"nothing connects {first.robot} to {second.robot}: their relative pose is unknown")
        if first == second:
            return np.zeros((6, 6))
        keys = Keys(tuple(self.trajectories))
        one, other = keys(first.robot, first.index), keys(second.robot, second.index)
        both = self._marginals.jointMarginalCovariance([one, other])
        joint = np.block([[both.at(a, b) for b in (one, other)] for a in (one, other)])
        poses = (self.trajectories[key.robot].poses[key.index] for key in (first, second))
        J = np.hstack([-se3.adjoint(se3.inverse(se3.between(*poses))), np.eye(6)])
        return np.asarray(self.sigma_scale**2 * J @ joint @ J.T)


def propagate_to_scans(scans_odom: Trajectory, keyframes_odom: Trajectory, keyframes_world: Trajectory) -> Trajectory:
    """The poses of all scans in the world, from those of their keyframes.

    Each scan keeps its odometry relative to the keyframe before and to the one after; where these two disagree, the
    pose moves from one to the other with time.  Exact at the keyframes.

    Args:
        scans_odom: poses of all scans, in the odometry frame.
        keyframes_odom: the keyframes in the same frame.
        keyframes_world: the same keyframes in the world.
    """
    stamps = keyframes_odom.stamps_ns
    before = np.clip(np.searchsorted(stamps, scans_odom.stamps_ns, side="right") - 1, 0, len(stamps) - 1)
    after = np.minimum(before + 1, len(stamps) - 1)
    from_before, from_after = (
        keyframes_world.poses[k] @ se3.between(keyframes_odom.poses[k], scans_odom.poses) for k in (before, after)
    )
    gap = np.maximum(stamps[after] - stamps[before], 1)
    share = np.clip((scans_odom.stamps_ns - stamps[before]) / gap, 0.0, 1.0)
    poses = from_before @ se3.exp(share[:, None] * se3.log(se3.between(from_before, from_after)))
    return Trajectory(scans_odom.robot, scans_odom.stamps_ns, poses, scans_odom.drift)
