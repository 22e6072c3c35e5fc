"""Multi-robot graphs from files: what is usable becomes odometry and closures, what is not is named."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.graph_files.matrices import covariances
from wiclosure.backends.graph_files.naming import Naming, Pose, pose_name
from wiclosure.backends.graph_files.parts import NamedGraph, Part, parts
from wiclosure.backends.graph_files.poses_of_edges import held_by_edges
from wiclosure.backends.graph_files.read import read_records
from wiclosure.backends.graph_files.records import Edge, FileRecords, Remarks, Vertex
from wiclosure.backends.graph_files.settings import GraphFileSettings
from wiclosure.errors import InputError
from wiclosure.types import Closure, FloatArray, IntArray, KeyframeId, Trajectory

WRITTEN = 1e-5  # what six digits leave of each metre of a measurement and its inverse: closer ones are one, said twice
LOCAL_M = 1e4  # coordinates beyond are a map's (UTM): covariances about an origin so far away lose their digits


@dataclass(frozen=True, slots=True)
class UnusableEdge:
    """A closure that cannot be used, where it stands, and why."""

    first: str
    second: str
    place: str
    reason: str


@dataclass(frozen=True, eq=False)
class GraphTeam:
    """Several robots' graphs.

    Args:
        odometry: by robot, from its own edges, which state the covariance of each step. Keyframe n has the stamp
            n seconds: the files know no time.
        indices: `(N,)` by robot: the index that the files give each keyframe.
        keys: `(N,)` uint64 by robot: the whole key in the files.
        closures: all other edges, each once although both robots' files may hold it.
        edges: the edge in the files of each closure.
        copies: other edges in the files that say the same as each closure.
        unnamed: robots that keys do not name, but their own edges.
        unusable: edges that are left out.
        origins: `(3,)` by robot: added to the positions of its odometry it gives those in the files.
        planar: whether all files are of planar graphs.
        ignored: how often each kind of line or measurement that is not used stands in the files.
        warnings: sentences: what was assumed, repaired or ignored.
        from_robot_log: whether all files are JSON Robot Logs.
        title: what the files call themselves.
    """

    odometry: dict[str, Trajectory]
    indices: dict[str, IntArray]
    keys: dict[str, NDArray[np.uint64]]
    closures: list[Closure]
    edges: list[Edge]
    copies: list[list[Edge]]
    unnamed: frozenset[str]
    unusable: tuple[UnusableEdge, ...]
    origins: dict[str, FloatArray]
    planar: bool
    from_robot_log: bool
    ignored: Mapping[str, int]
    warnings: tuple[str, ...]
    title: str

    @property
    def places(self) -> list[str]:
        """File and line of each closure."""
        return [edge.place for edge in self.edges]


def read_graphs(paths: Sequence[Path], settings: GraphFileSettings | None = None) -> GraphTeam:
    """Reads the graphs of one or several robots, in any of the formats, see `docs/graphs.md`.

    A robot is what its own edges connect.  Names tell robots apart (see `Naming`), and where they do not, edges do (see
    `by_own_edges`).  The edges that join a robot's poses are its odometry (see `odometry_tree`), all others closures.

    Raises:
        InputError: a file cannot be read or holds no poses, a line is malformed, or a robot's odometry is not usable.
    """
    remarks = Remarks()
    files = read_records(paths, remarks)
    edges = [edge for file in files for edge in file.edges]
    stated = covariances(edges, settings or GraphFileSettings(), remarks)
    naming = Naming(files)
    if naming.numbers_per_file and len(files) > 1:
        remarks.add("own numbers", "the files use the same numbers for different poses: no edge can join their robots")
    ends = [(naming(file, edge.first), naming(file, edge.second)) for file in files for edge in file.edges]
    vertices = _vertices(files, naming, ends, remarks)
    if not vertices:
        raise InputError(f"{', '.join(map(str, paths))}: no poses in it; give pose graphs (g2o, Toro, JSON Robot Log)")
    if len(vertices) > 1 and not edges:
        raise InputError(
            f"{', '.join(map(str, paths))}: {len(vertices)} poses and no edges; a pose graph states odometry and"
            " closures as edges (EDGE_SE3:QUAT)"
        )
    graph = NamedGraph(list(vertices), list(vertices.values()), edges, ends, stated, frozenset(naming.unnamed))
    return _team(graph, parts(graph, remarks), files, remarks)


def _vertices(
    files: Sequence[FileRecords], naming: Naming, ends: Sequence[tuple[Pose, Pose]], remarks: Remarks
) -> dict[Pose, Vertex]:
    """The vertex of each pose, sorted; of a pose that only edges hold, one without a guess."""
    vertices: dict[Pose, Vertex] = {}
    for file in files:
        for vertex in file.vertices:
            pose = naming(file, vertex.key)
            known = vertices.get(pose)
            if known is None or not known.is_known:
                vertices[pose] = vertex
            elif vertex.is_known and not np.array_equal(known.T_world_body, vertex.T_world_body):
                said = f"{vertex.place}: {pose_name(*pose)} stands already in {known.place}; that is used"
                remarks.add("stands already", said)
    return dict(
        sorted((held_by_edges([edge for file in files for edge in file.edges], ends, vertices) | vertices).items())
    )


def _team(graph: NamedGraph, found: Sequence[Part], files: Sequence[FileRecords], remarks: Remarks) -> GraphTeam:
    origins, odometry = {}, {}
    for part in found:
        T_world_first = _start(graph, part, remarks)
        far = np.abs(T_world_first[:3, 3]).max() > LOCAL_M
        origins[part.robot] = T_world_first[:3, 3].copy() if far else np.zeros(3)
        T_world_first[:3, 3] -= origins[part.robot]
        odometry[part.robot] = _trajectory(part, T_world_first)
    closures, edges, copies, unusable = _closures(graph, found)
    return GraphTeam(
        odometry=odometry,
        indices={part.robot: np.array([graph.poses[n].number for n in part.poses], np.int64) for part in found},
        keys={part.robot: np.array([graph.vertices[n].key for n in part.poses], np.uint64) for part in found},
        closures=closures,
        edges=edges,
        copies=copies,
        unnamed=frozenset(p.robot for p in found if graph.poses[p.poses[0]].robot in graph.unnamed),
        unusable=tuple(unusable),
        origins=origins,
        planar=all(file.planar for file in files if file.vertices or file.edges),
        from_robot_log=all(file.is_robot_log for file in files),
        ignored=dict(sum((file.ignored for file in files), Counter[str]())),
        warnings=remarks.sentences(),
        title=", ".join(dict.fromkeys(file.title or file.name for file in files)),
    )


def _start(graph: NamedGraph, part: Part, remarks: Remarks) -> FloatArray:
    vertex = graph.vertices[part.poses[0]]
    if vertex.is_known:
        return np.array(vertex.T_world_body)
    name = pose_name(*graph.poses[part.poses[0]])
    remarks.add("no start", f"{vertex.place}: no pose is given for {name}; {part.robot} starts at the origin")
    return np.eye(4)


def _trajectory(part: Part, T_world_first: FloatArray) -> Trajectory:
    poses = part.odometry.poses(T_world_first)
    rotations = Rotation.from_matrix(poses[:, :3, :3]).as_matrix()  # long products drift off the group by rounding
    return Trajectory(
        part.robot,
        np.arange(len(poses), dtype=np.int64) * 1_000_000_000,
        se3.from_rotation_translation(rotations, poses[:, :3, 3]),
        step_covariances=part.odometry.covariances,
        parents=None if part.odometry.is_chain else part.odometry.parents,
    )


def _closures(
    graph: NamedGraph, found: Sequence[Part]
) -> tuple[list[Closure], list[Edge], list[list[Edge]], list[UnusableEdge]]:
    """Each edge that is no odometry once, and its copies."""
    position = {int(n): KeyframeId(part.robot, place) for part in found for place, n in enumerate(part.poses)}
    closures, edges, copies, unusable = [], [], [], []
    for row, *repeats in _measurements(graph, [row for part in found for row in part.rows.tolist()]):
        edge = graph.edges[row]
        first, second = graph.ends[row]
        missing = [end for end, n in zip((first, second), graph.numbers[row], strict=True) if n < 0]
        loop = "joins a pose to itself" if first == second else ""
        reason = f"no file has a vertex {pose_name(*missing[0])}" if missing else graph.stated.defects[row] or loop
        if reason:
            unusable.append(UnusableEdge(pose_name(*first), pose_name(*second), edge.place, reason))
            continue
        query, match = (position[int(n)] for n in graph.numbers[row])
        covariance = graph.stated.matrices[row]
        closures.append(Closure.from_measurement(query, match, edge.T_first_second, covariance))
        edges.append(edge)
        copies.append([graph.edges[n] for n in repeats])
    return closures, edges, copies, unusable


def _measurements(graph: NamedGraph, odometry: Sequence[int]) -> list[list[int]]:
    """Rows of edges that state the same, without those that state what odometry does, in the order of the first ones.

    Many writers put edges between robots into both robots' files, each from its own pose to the other's.
    """
    known: defaultdict[frozenset[Pose], list[int]] = defaultdict(list)
    copies: dict[int, list[int]] = {}
    of_odometry = set(odometry)
    others = np.setdiff1d(np.arange(len(graph.edges)), odometry)
    for row in [*odometry, *others.tolist()]:
        between = known[frozenset(graph.ends[row])]
        same = next((other for other in between if _same_measurement(graph, row, other)), None)
        if same is None:
            between.append(row)
        copies.setdefault(row if same is None else same, []).append(row)
    return [rows for first, rows in copies.items() if first not in of_odometry]


def _same_measurement(graph: NamedGraph, row: int, other: int) -> bool:
    """Whether two edges between the same poses say the same, one of them perhaps the other way round.

    Measurements that agree to the last digit are one, whatever their matrices: two would each have an error of its own.
    """
    if graph.edges[row].defect or graph.edges[other].defect:  # no numbers to compare
        return False
    turned = graph.ends[row] != graph.ends[other]
    T_row, T_other = graph.edges[row].T_first_second, graph.edges[other].T_first_second
    digits = WRITTEN * (10.0 + np.abs(T_other[:3, 3]).max())
    return np.allclose(se3.inverse(T_row) if turned else T_row, T_other, rtol=0, atol=digits)
