"""The trajectories of all robots in one frame, as far as the radio joins them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from wiclosure.types import (
    FloatArray,
    FrameAlignment,
    IntArray,
    PredictionKind,
    RadioLinks,
    Trajectory,
    WirelessLog,
)
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.search.pair_model import PairModel
from wiclosure.wiclosure_filter.shared.graph_nodes import GraphNodes
from wiclosure.wiclosure_filter.shared.joint_estimate import JointEstimate, estimate, frames_from
from wiclosure.wiclosure_filter.shared.joint_factors import level_sigmas
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks
from wiclosure.wiclosure_filter.shared.shortest_route import ShortestRouteEstimate

# Median residual, in standard deviations, beyond which links contradict each other; 0.7 is expected, and robust kernels
# let a few outliers have any residual.
CONTRADICTION = 3.0


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

    def models(self, robot_a: str, robot_b: str) -> tuple[PairModel, ...]:
        """Predicted displacements of all pairs of keyframes; each pair is answered for by one of the models or more."""
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


def share_trajectories(
    trajectories: Mapping[str, Trajectory],
    wireless: WirelessLog,
    alignments: Sequence[FrameAlignment],
    settings: FilterSettings,
) -> SharedTrajectory:
    """Joins all robots that the certain ones of the alignments connect.

    Args:
        trajectories: keyframes of every robot.
        wireless: what `paths_kept` of the alignments refers to.
        alignments: of pairs of robots, a before b in the order of the trajectories.
        settings: joint estimate or shortest routes.
    """
    certain = [a for a in alignments if a.best is not None and not a.ambiguous]
    kept = {
        (a.robot_a, a.robot_b): KeptLinks.of(a.best, a.robot_a, a.robot_b, trajectories, wireless, settings.alignment)
        for a in certain
        if a.best is not None
    }
    if settings.shared_trajectory.method == "shortest":
        return _shortest(trajectories, certain, kept, settings)
    return _joint(trajectories, certain, kept, settings)


def _joint(
    trajectories: Mapping[str, Trajectory],
    alignments: Sequence[FrameAlignment],
    kept: Mapping[tuple[str, str], KeptLinks],
    settings: FilterSettings,
) -> SharedTrajectory:
    estimates: dict[tuple[str, str], SharedEstimate] = {}
    diagnosis: list[str] = []
    total = sum(len(links) for links in kept.values())
    most = settings.shared_trajectory.most_links
    if total > most:
        diagnosis.append(f"the joint estimate uses {most} of {total} links, evenly over the time")
        kept = {pair: links.thinned(max(1, most * len(links) // total)) for pair, links in kept.items()}
    left = list(trajectories)
    while left:
        frames = frames_from(left, list(alignments))
        own = {pair: links for pair, links in kept.items() if pair[0] in frames}
        if len(frames) > 1:
            try:
                joint, misfit = _component({r: trajectories[r] for r in frames}, frames, own, settings)
            except (RuntimeError, np.linalg.LinAlgError) as error:  # GTSAM: two antennas at one place, for example
                diagnosis.append(f"the joint estimate of {', '.join(frames)} failed ({error})")
                left = [robot for robot in left if robot not in frames]
                continue
            worst = max(misfit, key=lambda pair: misfit[pair])
            if len(own) > 1 and misfit[worst] > CONTRADICTION:
                # Each alignment holds by itself, but not all together: do without the one that fits least.
                a, b = worst
                diagnosis.append(
                    f"{a} and {b}: their links contradict those of the other robots"
                    f" (median residual {misfit[worst]:.1f} standard deviations); not used"
                )
                alignments = [al for al in alignments if (al.robot_a, al.robot_b) != worst]
                kept = {pair: links for pair, links in kept.items() if pair != worst}
                continue
            names = list(frames)
            estimates.update({(a, b): joint for i, a in enumerate(names) for b in names[i + 1 :]})
        left = [robot for robot in left if robot not in frames]
    used = {pair: links for pair, links in kept.items() if pair in estimates}
    return SharedTrajectory(estimates, tuple(diagnosis), _for_graph(used, alignments, trajectories, settings))


def _component(
    trajectories: Mapping[str, Trajectory],
    frames: Mapping[str, FloatArray],
    kept: Mapping[tuple[str, str], KeptLinks],
    settings: FilterSettings,
) -> tuple[JointEstimate, dict[tuple[str, str], float]]:
    """Joint estimate of robots that links join, and how badly the links of each pair fit it."""
    nodes, rows = _nodes(trajectories, kept, settings)
    joint = estimate(nodes, frames, kept, rows, settings)
    return joint, {pair: joint.misfit(links, *rows[pair]) for pair, links in kept.items()}


def _nodes(
    trajectories: Mapping[str, Trajectory], kept: Mapping[tuple[str, str], KeptLinks], settings: FilterSettings
) -> tuple[dict[str, GraphNodes], dict[tuple[str, str], tuple[IntArray, IntArray]]]:
    """Graph nodes of each robot, and for each pair of robots the nodes of its links at a and at b."""
    nodes, rows_at = {}, {}
    for robot, trajectory in trajectories.items():
        pairs = [pair for pair in kept if robot in pair]
        at_a = [pair[0] == robot for pair in pairs]
        links = [kept[pair].links for pair in pairs]
        keyframes = [at.index_a if is_a else at.index_b for at, is_a in zip(links, at_a, strict=True)]
        antennas = [at.antenna_a if is_a else at.antenna_b for at, is_a in zip(links, at_a, strict=True)]
        nodes[robot] = GraphNodes.along(
            trajectory,
            np.concatenate([np.zeros(0, np.int64), *keyframes]),
            np.concatenate([np.zeros((0, 3)), *antennas]),
            settings.shared_trajectory,
        )
        ends = np.cumsum([len(k) for k in keyframes])[:-1]
        rows_at[robot] = dict(zip(pairs, np.split(nodes[robot].of_link, ends), strict=True))
    return nodes, {pair: (rows_at[pair[0]][pair], rows_at[pair[1]][pair]) for pair in kept}


def _shortest(
    trajectories: Mapping[str, Trajectory],
    alignments: Sequence[FrameAlignment],
    kept: Mapping[tuple[str, str], KeptLinks],
    settings: FilterSettings,
) -> SharedTrajectory:
    estimates: dict[tuple[str, str], SharedEstimate] = {}
    diagnosis: list[str] = []
    for alignment in alignments:
        pair = (alignment.robot_a, alignment.robot_b)
        dimensions = 2 if settings.alignment.gravity_aligned else 3
        found = ShortestRouteEstimate.of(kept[pair], alignment, trajectories, dimensions)
        if found is None:
            diagnosis.append(f"{pair[0]} and {pair[1]}: shortest routes need links with both range and bearing")
        else:
            estimates[pair] = found
    used = {pair: kept[pair] for pair in estimates}
    return SharedTrajectory(estimates, tuple(diagnosis), _for_graph(used, alignments, trajectories, settings))


def _for_graph(
    used: Mapping[tuple[str, str], KeptLinks],
    alignments: Sequence[FrameAlignment],
    trajectories: Mapping[str, Trajectory],
    settings: FilterSettings,
) -> tuple[RadioLinks, ...]:
    level = np.diag(np.square(level_sigmas(settings)))
    T_a_b = {(al.robot_a, al.robot_b): al.best.T_a_b for al in alignments if al.best is not None}
    return tuple(links.for_graph(T_a_b[pair], level, trajectories) for pair, links in used.items())
