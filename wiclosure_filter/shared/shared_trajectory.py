"""The trajectories of all robots in one frame, as far as the radio joins them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from wiclosure.types import FloatArray, FrameAlignment, IntArray, PredictionKind, RadioLinks, Trajectory, robot_pairs
from wiclosure.wiclosure_filter.config import SharedTrajectorySettings
from wiclosure.wiclosure_filter.likelihood.frame_prior import FramePrior
from wiclosure.wiclosure_filter.links.links import Links
from wiclosure.wiclosure_filter.search.gates import Gate
from wiclosure.wiclosure_filter.search.pair_model import PairModel
from wiclosure.wiclosure_filter.shared.calibrated_links import without_errors
from wiclosure.wiclosure_filter.shared.constant_errors import PriorErrors, errors_of
from wiclosure.wiclosure_filter.shared.graph_nodes import NodeSpacing, TeamNodes
from wiclosure.wiclosure_filter.shared.joint_estimate import JointEstimate
from wiclosure.wiclosure_filter.shared.joint_optimum import JointOptimum, optimise
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks
from wiclosure.wiclosure_filter.shared.shortest_route import ShortestRouteEstimate
from wiclosure.wiclosure_filter.shared.team_frames import frames_from, settled

# Median residual, in standard deviations, beyond which links contradict each other; 0.7 is expected, and robust kernels
# let a few outliers have any residual.
CONTRADICTING_SIGMAS = 3.0


@runtime_checkable
class SharedEstimate(Protocol):
    """Predicts how keyframes of different robots lie to each other."""

    @property
    def kind(self) -> PredictionKind:
        """See `wiclosure.types.RelativePosePredictor`."""
        ...

    @property
    def alternatives(self) -> int:
        """How many likely alignments it rests on; 1 where one is certain."""
        ...

    def models(self, robot_a: str, robot_b: str, gate: Gate | None = None) -> tuple[PairModel, ...]:
        """Predicted displacements of all pairs of keyframes; each pair is answered for by one of the models or more.

        Where a gate is given, pairs that it cannot keep may be left out.
        """
        ...

    def may_meet(self, gate: Gate) -> set[tuple[str, str]]:
        """Pairs of robots, a before b; of others the gate can keep no pair of keyframes."""
        ...

    def rank(self, robot: str) -> int:
        """Place in an order in which robots that share much follow each other."""
        ...

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """See `wiclosure.types.RelativePosePredictor`."""
        ...


@dataclass(frozen=True, eq=False)
class SharedTrajectory:
    """What joins each pair of robots.

    Args:
        estimates: by pair of robots, in the order of the trajectories; pairs that nothing joins are missing.
        diagnosis: sentences on links that were left out.
        links: measurements that join robots, one entry for each two that measured each other.
    """

    estimates: Mapping[tuple[str, str], SharedEstimate] = field(default_factory=dict)
    diagnosis: tuple[str, ...] = ()
    links: tuple[RadioLinks, ...] = ()

    def may_meet(self, gate: Gate) -> set[tuple[str, str]]:
        """Pairs of robots that may meet by their estimates."""
        return set().union(*(estimate.may_meet(gate) for estimate in set(self.estimates.values())))

    def by_rank(self, pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
        """Pairs of robots in an order in which much of what is computed for one serves the next: is kept that long."""
        number = {estimate: n for n, estimate in enumerate(dict.fromkeys(self.estimates.values()))}

        def key(pair: tuple[str, str]) -> tuple[int, int, int, tuple[str, str]]:
            estimate = self.estimates[pair]
            ranks = [estimate.rank(robot) for robot in pair]
            return number[estimate], max(ranks), min(ranks), pair

        return sorted(pairs, key=key)


def share_trajectories(
    trajectories: Mapping[str, Trajectory],
    links: Mapping[tuple[str, str], Links],
    alignments: Sequence[FrameAlignment],
    prior: FramePrior,
    settings: SharedTrajectorySettings,
) -> SharedTrajectory:
    """Joins all robots that the certain ones of the alignments connect.

    Args:
        trajectories: keyframes of every robot.
        links: of every pair of robots that has an alignment.
        alignments: of pairs of robots, a before b in the order of the trajectories.
        prior: on how odometry frames lie to each other.
        settings: joint estimate or shortest routes.
    """
    certain = {(a.robot_a, a.robot_b): a for a in alignments if a.best is not None and not a.ambiguous}
    kept = {pair: _calibrated(a, links[pair], trajectories) for pair, a in certain.items()}
    if settings.method == "shortest":
        joined = _shortest(trajectories, certain, kept, prior.dimensions)
    else:
        joined = _joint(trajectories, certain, kept, prior, settings)
    used = tuple(
        own.for_graph(best.T_a_b, prior.covariance, trajectories)
        for pair, own in joined.used.items()
        if (best := certain[pair].best) is not None
    )
    return SharedTrajectory(joined.estimates, tuple(joined.diagnosis), used)


def _calibrated(alignment: FrameAlignment, links: Links, trajectories: Mapping[str, Trajectory]) -> KeptLinks:
    """The links that an alignment keeps, without the systematic errors that it found."""
    assert alignment.best is not None  # it is certain
    kept = KeptLinks.of(alignment.best, links)
    errors = errors_of(alignment)
    return kept if errors is None else without_errors(kept, errors.value, trajectories[alignment.robot_b])


@dataclass(frozen=True, eq=False)
class _Joined:
    """Estimates by pair of robots, the links that they rest on, and sentences on others."""

    estimates: Mapping[tuple[str, str], SharedEstimate]
    used: Mapping[tuple[str, str], KeptLinks]
    diagnosis: Sequence[str]


def _joint(
    trajectories: Mapping[str, Trajectory],
    certain: Mapping[tuple[str, str], FrameAlignment],
    kept: Mapping[tuple[str, str], KeptLinks],
    prior: FramePrior,
    settings: SharedTrajectorySettings,
) -> _Joined:
    """One estimate for each set of robots that the alignments connect."""
    kept, diagnosis = _thinned(kept, settings)
    kept = {pair: own.by_place(prior.settings.radio.static_radius_m) for pair, own in kept.items()}
    alignments, left = dict(certain), list(trajectories)
    estimates: dict[tuple[str, str], SharedEstimate] = {}
    while left:
        frames = frames_from(left, list(alignments.values()))
        if len(frames) > 1:
            own = {pair: links for pair, links in kept.items() if pair[0] in frames}
            frames = settled(frames, [alignments[pair] for pair in own], settings.robust_threshold)
            try:
                of_each = {pair: errors_of(alignments[pair]) for pair in own}
                errors = {pair: one for pair, one in of_each.items() if one is not None}
                optimum = _optimum({r: trajectories[r] for r in frames}, frames, own, errors, prior, settings)
                misfit = optimum.misfits()
                contradicting = _worst(misfit) if len(own) > 1 else []
                if not contradicting:
                    joint = JointEstimate.of(optimum)
                    estimates.update(dict.fromkeys(robot_pairs(list(frames)), joint))
            except (RuntimeError, np.linalg.LinAlgError) as error:  # GTSAM: two antennas at one place, for example
                diagnosis.append(f"the joint estimate of {', '.join(frames)} failed ({error})")
                left = [robot for robot in left if robot not in frames]
                continue
            for pair in contradicting:
                # Each alignment holds by itself, but not all together: do without the one that fits least.
                diagnosis.append(
                    f"{pair[0]} and {pair[1]}: their links contradict those of the other robots"
                    f" (median residual {misfit[pair]:.1f} standard deviations); not used"
                )
                del alignments[pair], kept[pair]
            if contradicting:
                continue
        left = [robot for robot in left if robot not in frames]
    return _Joined(estimates, {pair: links for pair, links in kept.items() if pair in estimates}, diagnosis)


def _worst(misfit: Mapping[tuple[str, str], float]) -> list[tuple[str, str]]:
    """Pairs whose links contradict the others most; of those that share a robot only the worst, for it may be why."""
    found: list[tuple[str, str]] = []
    for pair in sorted(misfit, key=lambda pair: -misfit[pair]):
        if misfit[pair] > CONTRADICTING_SIGMAS and not any(set(pair) & set(other) for other in found):
            found.append(pair)
    return found


def _thinned(
    kept: Mapping[tuple[str, str], KeptLinks], settings: SharedTrajectorySettings
) -> tuple[dict[tuple[str, str], KeptLinks], list[str]]:
    """At most so many links of all robots together, evenly, and a sentence where there were more."""
    total = sum(len(links) for links in kept.values())
    if total <= settings.most_links:
        return dict(kept), []
    most = {pair: max(settings.least_links, settings.most_links * len(own) // total) for pair, own in kept.items()}
    thinned = {pair: own.thinned(most[pair]) for pair, own in kept.items()}
    used = sum(len(own) for own in thinned.values())
    return thinned, [f"the joint estimate uses {used} of {total} links, evenly over the time"]


def _optimum(
    trajectories: Mapping[str, Trajectory],
    frames: Mapping[str, FloatArray],
    kept: Mapping[tuple[str, str], KeptLinks],
    of_errors: Mapping[tuple[str, str], PriorErrors],
    prior: FramePrior,
    settings: SharedTrajectorySettings,
) -> JointOptimum:
    """Where robots are that links join."""
    team = TeamNodes.along(trajectories, kept, NodeSpacing(settings.node_spacing_m, settings.node_turn_rad))
    return optimise(
        team,
        frames,
        prior,
        robust_threshold=settings.robust_threshold,
        drift_weight=settings.drift_weight,
        of_errors=of_errors,
    )


def _shortest(
    trajectories: Mapping[str, Trajectory],
    certain: Mapping[tuple[str, str], FrameAlignment],
    kept: Mapping[tuple[str, str], KeptLinks],
    dimensions: int,
) -> _Joined:
    """Shortest routes for each pair of robots that has an alignment."""
    found = {
        pair: ShortestRouteEstimate.of(kept[pair], alignment, trajectories, dimensions)
        for pair, alignment in certain.items()
    }
    estimates: dict[tuple[str, str], SharedEstimate] = {p: e for p, e in found.items() if e is not None}
    diagnosis = [
        f"{a} and {b}: shortest routes need links with both range and bearing"
        for (a, b), estimate_or_none in found.items()
        if estimate_or_none is None
    ]
    return _Joined(estimates, {pair: kept[pair] for pair in estimates}, diagnosis)
