"""What `wiclosure optimize` does: several robots' graphs in, one estimate out, every closure with its reason."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from wiclosure import se3
from wiclosure.backends.config import ClosureNoise, PcmSettings, PoseGraphSettings
from wiclosure.backends.consistency.pcm import PcmResult, pairwise_consistent
from wiclosure.backends.estimate.graph_result import GraphResult
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.graph_files.naming import pose_name
from wiclosure.backends.graph_files.team import GraphTeam, read_graphs
from wiclosure.pipeline.config import Config
from wiclosure.types import KeyframeId

logger = logging.getLogger(__name__)

STATED_IN_FULL = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
MAX_SCALE = 10.0  # stated covariances are often set by hand, and ten times too small is not rare


@dataclass(frozen=True, eq=False)
class MergedGraphs:
    """What was read, what consistency said, the estimate in the files' coordinates, and how long it took."""

    team: GraphTeam
    consistent: PcmResult
    graph: GraphResult
    seconds: float

    @property
    def diagnosis(self) -> tuple[str, ...]:
        """All sentences for the user, doubts of the map first."""
        found = self.consistent
        return (*found.doubts, *self.team.warnings, *found.remarks, *self.graph.diagnosis)

    def name(self, key: KeyframeId) -> str:
        """As the files have it."""
        return pose_name(key.robot, int(self.team.indices[key.robot][key.index]))


def merge_graphs(paths: Sequence[Path], config: Config) -> MergedGraphs:
    """Reads the graphs, decides on their closures and estimates all poses.

    Covariances are taken as the files state them, times what `pcm.max_scale` allows, unless the configuration says
    otherwise.

    Raises:
        InputError: a file cannot be used.
    """
    began = time.perf_counter()
    team = read_graphs(paths, config.graphs)
    _warn(team)
    pcm = _defaults(config.pcm, noise=STATED_IN_FULL, max_scale=MAX_SCALE)
    consistent = pairwise_consistent(team.closures, team.odometry, pcm)
    settings = _defaults(config.pose_graph, noise=STATED_IN_FULL).scaled(consistent.scale)
    graph = optimise(consistent.restated(team.odometry), consistent.closures, settings)
    return MergedGraphs(team, consistent, _in_coordinates_of_files(graph, team), time.perf_counter() - began)


def _warn(team: GraphTeam) -> None:
    for sentence in team.warnings:
        logger.warning("%s", sentence)
    if team.unusable:
        first, more = team.unusable[0], len(team.unusable) - 1
        rest = f" (and {more} more closures, see closures.csv)" if more else ""
        logger.warning("%s: left out, %s%s", first.place, first.reason, rest)


def _in_coordinates_of_files(graph: GraphResult, team: GraphTeam) -> GraphResult:
    """With the origin that reading took away; each component lies in the frame of its first robot."""
    moved = dict(graph.trajectories)
    for component in graph.components:
        T_file_world = se3.from_yaw(0.0, team.origins[component[0]])
        moved |= {robot: moved[robot].moved(T_file_world) for robot in component}
    return replace(graph, trajectories=moved)


S = TypeVar("S", PcmSettings, PoseGraphSettings)


def _defaults(settings: S, **values: object) -> S:
    """With these values where the user set none."""
    unset = {name: value for name, value in values.items() if name not in settings.model_fields_set}
    return settings.model_copy(update=unset)
