"""Which closures the estimate over all robots rests on, and where it starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import gtsam
import numpy as np

from wiclosure.backends.closure_sets import ClosureSet
from wiclosure.backends.config import PoseGraphSettings
from wiclosure.backends.estimate.graph_result import propagate_to_scans
from wiclosure.backends.estimate.measurements import Measurements
from wiclosure.backends.estimate.start import better_starts
from wiclosure.backends.factor_graph.factors import (
    Keys,
    anchor,
    closure_factors,
    inliers_among,
    keyframes_in_factors,
    odometry_factors,
    values_of,
    with_factors,
)
from wiclosure.backends.factor_graph.radio_factors import radio_factors
from wiclosure.backends.least_squares.edges import degrees_of_freedom, mahalanobis_squared
from wiclosure.backends.least_squares.graduated import graduated
from wiclosure.backends.least_squares.settling import settle
from wiclosure.backends.least_squares.system import System
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.types import BoolArray, FloatArray, IntArray

FEW_MORE = 1.5  # times the keyframes that measurements hold


def decide(
    measured: Measurements, rigid: Mapping[str, FloatArray], settings: PoseGraphSettings
) -> tuple[list[BoolArray], dict[str, FloatArray], float | None]:
    """Inliers (one mask a set) and poses of all keyframes, from a graph of the keyframes that measurements hold.

    The drift model gives the odometry between any two keyframes at once, so leaving out the others loses nothing; where
    they are many, it saves most of the time.  Where all are inliers, the least cost too: the sum of squared residuals.
    """
    if measured.radio or settings.robust == "cauchy":
        return *_decide_with_factors(measured, rigid, settings), None
    trajectories, rows, groups = measured.trajectories, measured.closures, measured.groups
    team = TeamArrays.of(trajectories, _numbered(measured.sets), np.zeros(rows, bool), _nodes(measured))
    limit = settings.inlier_limit(rows, team.robots.degrees) if settings.robust == "gnc" else np.inf
    held = np.array([team.robots.first_nodes[team.names.index(group[0])] for group in groups])
    known, loops = team.robots.odometry, team.robots.loops
    system = System.of(known + loops, team.stacked(rigid), held)
    starts = better_starts(team, system, groups, rigid, limit)
    (mask, poses), least = graduated(system, len(known), starts, limit), None
    if mask.all():
        least = float(mahalanobis_squared(system.edges.errors(poses), system.edges.covariance).sum())
    else:  # with outliers about, those kept may hide behind odometry that they bend
        settled = settle(known, loops, mask, np.ones(rows, bool), poses, held, limit)
        mask, poses = settled.inlier, settled.poses
    solved, moved = team.poses_of(poses), {}
    for robot, trajectory in trajectories.items():
        keyframes = trajectory.subset(team.nodes[robot])
        moved[robot] = propagate_to_scans(trajectory, keyframes, replace(keyframes, poses=solved[robot])).poses
    return _by_set(mask, measured.sets), moved, least


def _nodes(measured: Measurements) -> dict[str, IntArray]:
    """Keyframes that measurements hold, by robot; all of them where the others are few."""
    held = keyframes_in_factors(measured.trajectories, measured.sets)
    keyframes = {robot: np.arange(len(trajectory)) for robot, trajectory in measured.trajectories.items()}
    return keyframes if sum(map(len, keyframes.values())) <= FEW_MORE * sum(map(len, held.values())) else held


def _by_set(mask: BoolArray, sets: Sequence[ClosureSet]) -> list[BoolArray]:
    return np.split(mask, np.cumsum([len(closure_set) for closure_set in sets])[:-1]) if sets else []


def _numbered(sets: Sequence[ClosureSet]) -> list[ClosureSet]:
    """With rows counted through all sets."""
    starts = np.cumsum([0, *map(len, sets)])
    return [
        replace(closure_set, rows=start + np.arange(len(closure_set)))
        for closure_set, start in zip(sets, starts, strict=False)
    ]


def _decide_with_factors(
    measured: Measurements, rigid: Mapping[str, FloatArray], settings: PoseGraphSettings
) -> tuple[list[BoolArray], dict[str, FloatArray]]:
    """The same over GTSAM's factors: radio's are its own, and a kernel is."""
    trajectories, sets, radio = measured.trajectories, measured.sets, measured.radio
    keys, nodes = Keys(tuple(trajectories)), keyframes_in_factors(trajectories, [*sets, *radio])
    roots = {group[0] for group in measured.groups}
    anchors = [anchor(keys(r, 0), gtsam.Pose3(rigid[r][0]), loose=r not in roots) for r in trajectories]
    known = with_factors(
        odometry_factors(trajectories, [*sets, *radio], keys, nodes),
        [*anchors, *radio_factors(radio, trajectories, keys)],
    )
    steps = (t.relative_pose(*t.steps(nodes[robot])) for robot, t in trajectories.items())
    degrees = degrees_of_freedom(*steps, *(closure_set.T_a_b for closure_set in sets))
    mask, values = inliers_among(closure_factors(sets, keys), known, values_of(rigid, nodes), settings, degrees)
    poses = {}
    for robot, trajectory in trajectories.items():
        held = trajectory.subset(nodes[robot])
        solved = np.stack([values.atPose3(key).matrix() for key in keys.all(robot, nodes[robot])])
        poses[robot] = propagate_to_scans(trajectory, held, replace(held, poses=solved)).poses
    return _by_set(mask, sets), poses
