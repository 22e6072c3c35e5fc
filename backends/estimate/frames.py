"""Where the robots' odometry frames lie, roughly: the start of every estimate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import networkx as nx
import numpy as np

from wiclosure import se3
from wiclosure.backends.closure_sets import ClosureSet
from wiclosure.types import FloatArray, IntArray, RadioLinks, Trajectory

CANDIDATES = 300  # closures tried as the frame transform; more would not find a better one


def components(
    robots: Sequence[str], sets: Sequence[ClosureSet], radio: Sequence[RadioLinks] = ()
) -> tuple[tuple[str, ...], ...]:
    """Groups of robots that closures or radio connect, in the order of `robots`; the first holds the first robot."""
    rank = {robot: n for n, robot in enumerate(robots)}
    connected = nx.connected_components(_connections(robots, sets, radio))
    groups = (tuple(sorted(group, key=rank.__getitem__)) for group in connected)
    return tuple(sorted(groups, key=lambda group: rank[group[0]]))


def initial_frames(
    trajectories: Mapping[str, Trajectory], sets: Sequence[ClosureSet], radio: Sequence[RadioLinks] = ()
) -> dict[str, FloatArray]:
    """`T_world_odom` of each robot along the tree of the best supported pairs; by radio only where no closure leads.

    The world is the odometry frame of the first robot of each component.
    """
    robots = list(trajectories)
    tree = nx.maximum_spanning_tree(_connections(robots, sets, radio), weight="closures")
    transforms = {(links.robot_a, links.robot_b): links.T_a_b for links in radio}
    transforms |= {(b, a): se3.inverse(T_a_b) for (a, b), T_a_b in transforms.items()}
    closed = {
        (closure_set.robot_a, closure_set.robot_b): frame_transform(closure_set, trajectories)
        for closure_set in sets
        if closure_set.between_robots and len(closure_set)
    }
    transforms |= closed | {(b, a): se3.inverse(T_a_b) for (a, b), T_a_b in closed.items()}
    frames: dict[str, FloatArray] = {}
    for root in robots:
        if root not in frames:
            frames[root] = np.eye(4)
            for parent, child in nx.bfs_edges(tree, root):
                frames[child] = frames[parent] @ transforms[parent, child]
    return frames


def frame_estimates(closure_set: ClosureSet, trajectories: Mapping[str, Trajectory]) -> FloatArray:
    """`(N, 4, 4)`: odometry frame of b in that of a, as each closure alone has it."""
    T_odom_a = trajectories[closure_set.robot_a].poses[closure_set.index_a]
    T_odom_b = trajectories[closure_set.robot_b].poses[closure_set.index_b]
    return np.asarray(T_odom_a @ closure_set.T_a_b @ se3.inverse(T_odom_b))


def frame_transform(closure_set: ClosureSet, trajectories: Mapping[str, Trajectory]) -> FloatArray:
    """The one of the closures' frame estimates `(4, 4)` that most others agree with.

    Each closure says where b's keyframe is in a's frame; an estimate pays for its distance to these places, but no more
    than odometry can have drifted: what is further off is false and tells nothing.  So it stands up to any share of
    false closures that do not agree among themselves, which a mean or a median does not.
    """
    estimates = frame_estimates(closure_set, trajectories)
    place_b = trajectories[closure_set.robot_b].positions[closure_set.index_b]
    place_a = (trajectories[closure_set.robot_a].poses[closure_set.index_a] @ closure_set.T_a_b)[:, :3, 3]
    tried = estimates[np.linspace(0, len(closure_set) - 1, min(len(closure_set), CANDIDATES)).round().astype(int)]
    predicted_a = np.einsum("cij,nj->cni", tried[:, :3, :3], place_b) + tried[:, None, :3, 3]
    apart = np.linalg.norm(predicted_a - place_a, axis=2)
    reach = (
        1.0
        + _drift_m(trajectories[closure_set.robot_a], closure_set.index_a)
        + _drift_m(trajectories[closure_set.robot_b], closure_set.index_b)
    )
    return np.asarray(tried[np.argmin(np.minimum(apart, reach).sum(axis=1))])


def _drift_m(trajectory: Trajectory, indices: IntArray) -> float:
    """How far, m (one sigma), odometry may drift between the first and the last of the keyframes."""
    covariance = trajectory.relative_covariance(np.array([indices.min()]), np.array([indices.max()]))
    return float(np.sqrt(np.trace(covariance[0, 3:, 3:])))


def _connections(robots: Sequence[str], sets: Sequence[ClosureSet], radio: Sequence[RadioLinks]) -> nx.Graph[str]:
    graph: nx.Graph[str] = nx.Graph()
    graph.add_nodes_from(robots)
    graph.add_weighted_edges_from(
        ((links.robot_a, links.robot_b, 0) for links in radio if len(links)), weight="closures"
    )
    graph.add_weighted_edges_from(
        (
            (closure_set.robot_a, closure_set.robot_b, len(closure_set))
            for closure_set in sets
            if closure_set.between_robots and len(closure_set)
        ),
        weight="closures",
    )
    return graph
