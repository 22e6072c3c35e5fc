"""The back end while robots drive: keyframes and closures arrive, decisions and poses follow (iSAM2).

Kaess et al., "iSAM2: Incremental smoothing and mapping using the Bayes tree", IJRR 2012.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import gtsam
import networkx as nx
import numpy as np

from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import PcmSettings, PoseGraphSettings
from wiclosure.backends.consistency.incremental import IncrementalConsistency
from wiclosure.backends.estimate.graph_result import GraphResult
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.factor_graph.earth_factors import Ground
from wiclosure.backends.factor_graph.factors import Keys, closure_factors, odometry_factors, with_factors
from wiclosure.backends.least_squares.edges import degrees_of_freedom
from wiclosure.blas import one_blas_thread
from wiclosure.types import Closure, EarthMeasurements, FloatArray, Stage, Trajectory, measured_poses


class StreamingBackEnd:
    """Consistency and estimate, both again with each closure, so that an early mistake heals.

    `poses` are iSAM2's at any time; `result` is the batch answer over all closures, which they approach.

    Args:
        trajectories: keyframe odometry of all robots so far, one keyframe each at least.
        pcm: settings of the consistency check; defaults where None.
        settings: settings of the estimate; likewise.
        earth: which way is up, and where, so far.
    """

    def __init__(
        self,
        trajectories: Mapping[str, Trajectory],
        pcm: PcmSettings | None = None,
        settings: PoseGraphSettings | None = None,
        earth: EarthMeasurements | None = None,
    ) -> None:
        self._odometry = dict(trajectories)
        self._keys = Keys(tuple(trajectories))
        self._settings = settings or PoseGraphSettings()
        self._earth, self._ground = earth or EarthMeasurements(), Ground()
        self._consistency = IncrementalConsistency(pcm or PcmSettings())
        self._closures: list[Closure] = []
        self._slots: dict[int, int] = {}  # row of each closure in the estimate: its place among iSAM2's factors
        self._switched_off: set[int] = set()  # inliers of the check that the estimate contradicts
        self._groups: set[frozenset[str]] = set()
        steps = (t.relative_pose(*t.steps(np.arange(len(t)))) for t in trajectories.values())
        self._degrees = degrees_of_freedom(*steps)
        self._restart()

    def poses(self, robot: str) -> FloatArray:
        """`T_world_body (N, 4, 4)` of all keyframes of a robot."""
        estimate, size = self._isam.calculateEstimate(), len(self._odometry[robot])
        return np.stack([estimate.atPose3(self._keys(robot, n)).matrix() for n in range(size)])

    @one_blas_thread
    def result(self) -> GraphResult:
        """The batch estimate over all closures so far, every decision taken anew."""
        return self._batch()

    def _batch(self) -> GraphResult:
        checked = self._consistency.result()
        return optimise(checked.restated(self._odometry), checked.closures, self._settings, earth=self._earth)

    def extend(self, trajectories: Mapping[str, Trajectory], earth: EarthMeasurements | None = None) -> None:
        """Takes new keyframes in.

        Args:
            trajectories: keyframe odometry of all robots, the keyframes known so far first.
            earth: all that is known of the Earth by now, what was known before first.
        """
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        for robot, trajectory in trajectories.items():
            known = len(self._odometry[robot])
            if len(trajectory) == known:
                continue
            nodes = {robot: np.arange(known - 1, len(trajectory))}
            graph.push_back(odometry_factors({robot: trajectory}, [], self._keys, nodes))
            last = self._isam.calculateEstimatePose3(self._keys(robot, known - 1)).matrix()
            steps = trajectory.relative_pose(np.full(len(trajectory) - known, known - 1), nodes[robot][1:])
            self._degrees = max(self._degrees, degrees_of_freedom(steps))
            for index, pose in zip(nodes[robot][1:], last @ steps, strict=True):
                values.insert(self._keys(robot, index), gtsam.Pose3(pose))
        self._odometry = dict(trajectories)
        if earth is not None:
            before, self._earth, self._ground = self._ground, earth, replace(self._ground, earth=earth)
            new = self._ground.since(before).factors(self._keys)
            graph.push_back(with_factors(gtsam.NonlinearFactorGraph(), new))
        self._isam.update(graph, values)

    @one_blas_thread
    def add(self, closures: Sequence[Closure]) -> None:
        """Takes new closures in, and takes back what they show to be wrong.

        Raises:
            InputError: a closure names a robot or a keyframe that is not there.
        """
        self._consistency.add(closures, self._odometry)
        self._closures += closures
        measured, _ = measured_poses([closure for closure in closures if closure.measured is not None])
        self._degrees = max(self._degrees, degrees_of_freedom(measured))
        inliers = set(self._consistency.inlier_rows)
        if self._connected(inliers) != self._groups:
            self._restart()
            return
        self._switched_off &= inliers
        wanted = inliers - self._switched_off
        new = wanted - self._slots.keys()
        self._update(new, self._slots.keys() - wanted)
        if self._settings.robust != "none":
            self._switch(new)

    def _switch(self, new: set[int]) -> None:
        """Switches off new closures that the estimate contradicts, and on those that it no longer does."""
        limit = self._settings.inlier_limit(len(self._closures), self._degrees)
        off = {row for row in new if self._chi_square(row) >= limit}
        on = {row for row in self._switched_off if self._chi_square(row) < limit}
        self._switched_off = (self._switched_off - on) | off
        self._update(on, off)

    def _update(self, new: set[int], gone: set[int]) -> None:
        if not new and not gone:
            return
        factors = gtsam.NonlinearFactorGraph()
        for row in sorted(new):
            factors.add(self._factor(row))
        removed = [self._slots.pop(row) for row in sorted(gone)]
        update = self._isam.update(factors, gtsam.Values(), removed)
        self._slots |= dict(zip(sorted(new), update.getNewFactorsIndices(), strict=True))

    def _restart(self) -> None:
        """From the batch estimate: robots that come together move too far for the old linearisation."""
        estimate = self._batch()
        self._ground = estimate.ground
        inliers = self._consistency.inlier_rows
        accepted = sorted(row for row in inliers if estimate.closures[row].survived(Stage.ESTIMATE))
        anchors = [
            self._ground.anchor(group, self._keys(group[0], 0), estimate.trajectories[group[0]].poses[0])
            for group in estimate.components
        ]
        of_earth = self._ground.factors(self._keys)
        known = with_factors(odometry_factors(self._odometry, [], self._keys), [*anchors, *of_earth])
        graph = with_factors(known, [self._factor(row) for row in accepted])
        self._isam = gtsam.ISAM2(gtsam.ISAM2Params())
        self._isam.update(graph, estimate.values)
        self._slots = {row: known.size() + n for n, row in enumerate(accepted)}
        self._switched_off = set(inliers) - set(accepted)
        self._groups = self._connected(set(inliers))

    def _factor(self, row: int) -> gtsam.BetweenFactorPose3:
        sets, _ = closure_sets([self._closures[row]], self._odometry, self._settings.noise)
        return closure_factors(sets, self._keys)[0]

    def _chi_square(self, row: int) -> float:
        factor, values = self._factor(row), gtsam.Values()
        for key in factor.keys():  # noqa: SIM118 - a factor is no dictionary
            values.insert(key, self._isam.calculateEstimatePose3(key))
        return 2.0 * float(factor.error(values))

    def _connected(self, rows: set[int]) -> set[frozenset[str]]:
        """Groups of robots that these closures connect."""
        links: nx.Graph[str] = nx.Graph()
        links.add_nodes_from(self._odometry)
        closures = (self._closures[row] for row in rows)
        links.add_edges_from({(closure.query.robot, closure.match.robot) for closure in closures})
        return {frozenset(group) for group in nx.connected_components(links)}
