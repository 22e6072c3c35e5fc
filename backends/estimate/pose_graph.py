"""One estimate over the keyframes of all robots, in the frame of the first."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.backends.closure_sets import ClosureSet, Decision, closure_sets, decided
from wiclosure.backends.config import PoseGraphSettings
from wiclosure.backends.estimate.frames import initial_frames
from wiclosure.backends.estimate.graph_result import GraphResult
from wiclosure.backends.estimate.inliers import decide
from wiclosure.backends.estimate.measurements import Measurements
from wiclosure.backends.estimate.two_stage import placed_in_two_stages
from wiclosure.backends.factor_graph.earth_factors import Ground
from wiclosure.backends.factor_graph.factors import (
    Keys,
    closure_factors,
    least_squares,
    odometry_factors,
    ordering,
    values_of,
    with_factors,
)
from wiclosure.backends.factor_graph.radio_factors import radio_factors
from wiclosure.blas import one_blas_thread
from wiclosure.display import listed
from wiclosure.errors import InputError
from wiclosure.types import BoolArray, Closure, EarthMeasurements, FloatArray, RadioLinks, Residual, Stage, Trajectory

AT_LEAST = 1e-5  # of the cost, by which GTSAM lowers it at least in a step, else it ends too

logger = logging.getLogger(__name__)

__all__ = ["GraphResult", "optimise"]


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Which closures are inliers (one mask a set), the poses `T_world_body` by robot, and GTSAM's graph and values."""

    inliers: list[BoolArray]
    poses: dict[str, FloatArray]
    diagnosis: tuple[str, ...] = ()
    solved: tuple[gtsam.NonlinearFactorGraph, gtsam.Values] | None = None
    ground: Ground = field(default_factory=Ground)


@one_blas_thread
def optimise(
    trajectories: Mapping[str, Trajectory],
    closures: Sequence[Closure],
    settings: PoseGraphSettings | None = None,
    radio: Sequence[RadioLinks] = (),
    earth: EarthMeasurements | None = None,
) -> GraphResult:
    """Merges the robots' keyframe trajectories over their live closures.

    Args:
        trajectories: keyframe odometry by robot, with its drift model; the odometry frame of `settings.anchor`, or of
            the first robot, is the world.
        closures: between robots or within one; those not measured yet, or rejected, pass through unchanged.
        settings: defaults where None.
        radio: measurements between robots; used where `settings.radio` says so.
        earth: which way is up at keyframes, and where they are; the z axes of the odometry frames of robots that know
            up must point there already.

    Returns:
        Trajectories, frames, and every closure accepted or rejected with a reason. Robots that nothing connects stay in
        their own frame.

    Raises:
        InputError: no trajectory; no robot is called `settings.anchor`; or a closure names a robot or a keyframe that
            the trajectories do not have.
    """
    settings = settings or PoseGraphSettings()
    if not trajectories:
        raise InputError("no trajectory to estimate; pass the keyframe trajectory of at least one robot")
    trajectories = _anchored(trajectories, settings.anchor)
    sets, unusable = closure_sets(closures, trajectories, settings.noise)
    measured = Measurements(trajectories, sets, radio if settings.radio else ())
    found = _estimate(measured, settings, earth or EarthMeasurements())
    kept = measured.among(found.inliers)
    decisions = {row: Decision(False, reason) for row, reason in unusable.items()}
    for closure_set, mask in zip(sets, found.inliers, strict=True):
        decisions |= _decisions(closure_set, mask, found.poses, closures)
    groups = kept.groups
    graph, values = found.solved or (
        _final_graph(kept, found.poses, found.ground),
        values_of(found.poses),
    )
    result = GraphResult(
        trajectories={r: replace(t, poses=found.poses[r], finer=None) for r, t in trajectories.items()},
        T_world_odom={r: found.poses[r][0] @ se3.inverse(t.poses[0]) for r, t in trajectories.items()},
        components=found.ground.joined(groups),
        closures=tuple(decided(closures, Stage.ESTIMATE, decisions)),
        diagnosis=found.diagnosis + _connection_report(found.ground.joined(groups), closures, kept, measured),
        graph=graph,
        values=values,
        sigma_scale=settings.sigma_scale,
        ground=found.ground,
    )
    return replace(result, closures=_with_residuals(result))


def _with_residuals(result: GraphResult) -> tuple[Closure, ...]:
    """Every closure with its distance from the estimate, whatever was decided on it; None where nothing connects."""
    residuals = result.residuals(result.closures)
    angles, distances = (np.linalg.norm(part, axis=1).tolist() for part in (residuals[:, :3], residuals[:, 3:]))
    return tuple(
        replace(c, residual=Residual(m, rad) if np.isfinite(m) else None)
        for c, m, rad in zip(result.closures, distances, angles, strict=True)
    )


def _anchored(trajectories: Mapping[str, Trajectory], anchor_robot: str) -> Mapping[str, Trajectory]:
    """With the robot first whose odometry frame is to be the world."""
    if not anchor_robot:
        return trajectories
    if anchor_robot not in trajectories:
        raise InputError(f"pose_graph.anchor is {anchor_robot!r}; the robots are {', '.join(trajectories)}")
    return {anchor_robot: trajectories[anchor_robot]} | dict(trajectories)


def _estimate(measured: Measurements, settings: PoseGraphSettings, earth: EarthMeasurements) -> _Estimate:
    """By the chosen optimiser; where that fails numerically, only the rigid start, and a sentence that says so."""
    trajectories, sets = measured.trajectories, measured.sets
    frames = initial_frames(trajectories, sets, measured.radio)
    rigid = {r: frames[r] @ t.poses for r, t in trajectories.items()}
    try:
        if settings.optimiser == "joint":
            return _joint(measured, rigid, settings, earth)
        masks, frames = placed_in_two_stages(trajectories, sets, settings, earth)
        groups = measured.among(masks).groups
        ground, poses = Ground.under(groups, {r: frames[r] @ t.poses for r, t in trajectories.items()}, earth)
        return _Estimate(masks, poses, ground.diagnosis, ground=ground)
    except RuntimeError as error:  # GTSAM's own, thrown for indeterminate systems
        logger.debug("the estimate failed", exc_info=True)
        first_line = str(error).strip().partition("\n")[0]
        sentence = f"the estimate failed ({first_line}); trajectories are placed rigidly, drift stays in"
        return _Estimate([np.ones(len(closure_set), bool) for closure_set in sets], rigid, (sentence,))


def _joint(
    measured: Measurements, rigid: Mapping[str, FloatArray], settings: PoseGraphSettings, earth: EarthMeasurements
) -> _Estimate:
    """First decide on the closures, then solve for all keyframes with the inliers."""
    masks, poses, least = decide(measured, rigid, settings)
    kept = measured.among(masks)
    start = _reset_unconnected(measured.trajectories, kept.groups, poses)
    ground, start = Ground.under(kept.groups, start, earth)
    graph = _final_graph(kept, start, ground)
    values = values_of(start)
    if least is None or 2.0 * graph.error(values) > (1.0 + AT_LEAST) * least:
        values = least_squares(graph, values, ordering(graph))
        start = _poses(values, measured.trajectories)
    return _Estimate(masks, start, ground.diagnosis, (graph, values), ground)


def _final_graph(kept: Measurements, poses: Mapping[str, FloatArray], ground: Ground) -> gtsam.NonlinearFactorGraph:
    """Odometry, accepted closures, radio, what is known of the Earth, and the first pose of each component held."""
    trajectories, keys = kept.trajectories, Keys(tuple(kept.trajectories))
    anchors = [ground.anchor(group, keys(group[0], 0), poses[group[0]][0]) for group in kept.groups]
    radio = radio_factors(kept.radio, trajectories, keys)
    measured = [*closure_factors(kept.sets, keys), *radio, *ground.factors(keys)]
    return with_factors(odometry_factors(trajectories, [*kept.sets, *kept.radio], keys), [*measured, *anchors])


def _reset_unconnected(
    trajectories: Mapping[str, Trajectory], groups: Sequence[Sequence[str]], poses: dict[str, FloatArray]
) -> dict[str, FloatArray]:
    """Components that the first robot is not part of go back to the odometry frame of their own first robot."""
    moved = dict(poses)
    for group in groups:
        T_new_world = trajectories[group[0]].poses[0] @ se3.inverse(poses[group[0]][0])
        moved |= {robot: T_new_world @ poses[robot] for robot in group}
    return moved


def _poses(values: gtsam.Values, trajectories: Mapping[str, Trajectory]) -> dict[str, FloatArray]:
    keys = Keys(tuple(trajectories))
    return {
        robot: np.stack([values.atPose3(key).matrix() for key in keys.all(robot, np.arange(len(trajectory)))])
        for robot, trajectory in trajectories.items()
    }


# ------------------------------------------------------------------------------------------------------------ reports
def _decisions(
    closure_set: ClosureSet, mask: BoolArray, poses: Mapping[str, FloatArray], closures: Sequence[Closure]
) -> dict[int, Decision]:
    """By row of the closure list."""
    estimated = se3.between(
        poses[closure_set.robot_a][closure_set.index_a], poses[closure_set.robot_b][closure_set.index_b]
    )
    error = se3.between(closure_set.T_a_b, estimated)
    metres = np.linalg.norm(error[:, :3, 3], axis=1)
    degrees = np.degrees(se3.rotation_angle(error))
    return {
        int(row): Decision(True, closures[row].reason or "agrees with the estimate")
        if keep
        else Decision(False, f"contradicts the joint estimate, {m:.2f} m and {d:.1f} degrees off it")
        for row, keep, m, d in zip(closure_set.rows, mask, metres, degrees, strict=True)
    }


def _connection_report(
    groups: Sequence[Sequence[str]], closures: Sequence[Closure], kept: Measurements, measured: Measurements
) -> tuple[str, ...]:
    """Sentences: what was rejected, and which robots could not be placed."""
    rejected = measured.closures - kept.closures
    sentences = [f"the estimate rejected {rejected} of {measured.closures} closures"] if rejected else []
    for group in groups[1:]:
        names, stays = listed(group), "it stays" if len(group) == 1 else "they stay"
        frame = "its own frame" if len(group) == 1 else f"the frame of {group[0]}"
        tried = any((c.query.robot in group) != (c.match.robot in group) for c in closures)
        apart = f"no accepted closure connects {names} to {groups[0][0]}"
        sentences.append(
            f"{apart if tried else f'there is no closure between {names} and other robots'}: {stays} in {frame}"
        )
    return tuple(sentences)
