"""Wi-Closure before Swarm-SLAM's choice of inter-robot closures: its edges in, those that the radio allows out.

Swarm-SLAM lists look-alike keyframes as edges (robot and keyframe of either end, similarity as weight) and spends a
budget of registrations on the best of them.  `allowed` stands between the two: it drops edges that cannot be, weighs
the others by their chance of overlap, and says where their registration should start.

python examples/swarm_slam.py
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wiclosure import (
    AoaPath,
    FilterResult,
    FilterSettings,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
    make_filter,
    se3,
)


class EdgeInterRobot(NamedTuple):
    """As Swarm-SLAM has it (cslam/algebraic_connectivity_maximization.py)."""

    robot0_id: int
    robot0_image_id: int
    robot1_id: int
    robot1_image_id: int
    weight: float


def allowed(
    edges: Sequence[EdgeInterRobot], result: FilterResult, names: Sequence[str]
) -> list[tuple[EdgeInterRobot, np.ndarray | None]]:
    """The edges that the filter keeps, each with the predicted `T_0_1 (4, 4)` of its keyframes, or None.

    Their weight is the similarity times the probability of overlap.

    Args:
        edges: candidates between any two robots, either first.
        result: of the filter.
        names: of the robots by their number.
    """
    kept = []
    for pairs in result.pairs:
        a, b = names.index(pairs.robot_a), names.index(pairs.robot_b)
        between = [e for e in edges if {e.robot0_id, e.robot1_id} == {a, b}]
        forward = np.array([e.robot0_id == a for e in between], bool)
        ends = np.array([[e.robot0_image_id, e.robot1_image_id] for e in between], np.int64).reshape(-1, 2)
        ends[~forward] = ends[~forward, ::-1]
        width = 1 + max(pairs.index_b.max(initial=0), ends[:, 1].max(initial=0))  # one number for each pair
        order = np.argsort(pairs.index_a * width + pairs.index_b)
        keys = (pairs.index_a * width + pairs.index_b)[order]
        wanted = ends[:, 0] * width + ends[:, 1]
        at = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        found = np.flatnonzero(keys[at] == wanted) if len(keys) else np.zeros(0, int)
        predicted = pairs.predicted(order[at[found]])
        for row, i in enumerate(found):
            T_a_b = None if predicted is None else predicted[0][row]
            T_0_1 = T_a_b if T_a_b is None or forward[i] else se3.inverse(T_a_b)
            overlap = float(pairs.overlap_probability[order[at[i]]])
            kept.append((between[i]._replace(weight=between[i].weight * overlap), T_0_1))
    return kept


def best(edges: Sequence[EdgeInterRobot], budget: int) -> list[EdgeInterRobot]:
    """What Swarm-SLAM registers while nothing joins the robots yet: the most similar ones."""
    return sorted(edges, key=lambda e: -e.weight)[:budget]


# --- A street whose houses repeat every 24 m: two robots drive along it, towards each other. --------------------------
rng = np.random.default_rng(0)
NAMES = ["robot_0", "robot_1"]
along = 2.0 * np.arange(150)
winding = 15.0 * np.sin(along / 40.0)
positions = [np.stack([along, winding, 0 * along], axis=1), np.stack([along, winding + 4.0, 0 * along], axis=1)[::-1]]
headings = [np.arctan2(np.gradient(p[:, 1]), np.gradient(p[:, 0])) for p in positions]
world = [se3.from_yaw(yaw, p) for yaw, p in zip(headings, positions, strict=True)]
stamps_ns = np.arange(150) * 10**9
odometry = {name: Trajectory(name, stamps_ns, se3.inverse(T[0]) @ T) for name, T in zip(NAMES, world, strict=True)}

# Place recognition cannot tell one house from the next: similarity depends on where between houses a scan was taken.
i, j = (index.ravel() for index in np.meshgrid(np.arange(150), np.arange(150), indexing="ij"))
apart_m = positions[0][i, 0] - positions[1][j, 0]
similarity = 1.0 - np.abs(apart_m - 24.0 * np.rint(apart_m / 24.0)) / 24.0 + rng.normal(0, 0.02, len(i))
likely = np.argsort(-similarity)[:1500]
edges = [EdgeInterRobot(0, int(i[k]), 1, int(j[k]), float(similarity[k])) for k in likely]

# --- What their radios measured while they passed each other: range, and a bearing among two reflections. ------------
measurements = []
for k in range(50, 100, 3):
    x, y, _ = se3.between(world[0][k], world[1][k])[:3, 3]
    bearings = [np.arctan2(y, x) + rng.normal(0, 0.1), *rng.uniform(-3, 3, 2)]
    paths = tuple(AoaPath(azimuth=float(b), sigma=0.17) for b in bearings)
    distance = float(np.hypot(x, y) + rng.normal(0, 0.3))
    measurements.append(
        WirelessMeasurement(
            stamp_ns=int(stamps_ns[k]),
            receiver="robot_0",
            transmitter="robot_1",
            range_m=distance,
            range_sigma_m=0.3,
            paths=paths,
        )
    )

settings = FilterSettings.model_validate({"gate": {"sensor_range_m": 12.0}})  # scans farther apart share no house
result = make_filter("wiclosure", settings).candidates(odometry, WirelessLog(tuple(measurements)))


def true(edge: EdgeInterRobot) -> bool:
    """Whether both keyframes show the same houses."""
    return bool(abs(positions[0][edge.robot0_image_id, 0] - positions[1][edge.robot1_image_id, 0]) < 12.0)


with_radio = allowed(edges, result, NAMES)
chosen, chosen_by_radio = best(edges, 30), best([edge for edge, _ in with_radio], 30)
print(f"candidates: {len(edges)}, allowed by the radio: {len(with_radio)}")
print(f"of 30 registrations, true without radio: {sum(map(true, chosen))}, with: {sum(map(true, chosen_by_radio))}")
