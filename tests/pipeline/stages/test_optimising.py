from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.stages.merged_folder import summary, write_merged
from wiclosure.pipeline.stages.optimising import merge_graphs
from wiclosure.types import KeyframeId

SIGMA = np.repeat([0.01, 0.05], 3)
INFORMATION = " ".join(map(str, np.diag(1 / np.roll(SIGMA, 3) ** 2)[np.triu_indices(6)]))


def numbers(T):
    return " ".join(map(repr, [*T[:3, 3].tolist(), *Rotation.from_matrix(T[:3, :3]).as_quat().tolist()]))


@pytest.fixture(scope="module")
def graph(tmp_path_factory):
    """Two robots on arcs, far from the origin of their map; eight true closures, one of them without a vertex."""
    rng = np.random.default_rng(0)
    keys = {robot: ord(robot) << 56 for robot in "ab"}
    angle = np.linspace(0, 3, 30)
    truth = {
        "a": se3.from_yaw(angle, np.stack([10 * np.sin(angle), 10 - 10 * np.cos(angle), 0 * angle], axis=1)),
        "b": se3.from_yaw(angle + 1, np.stack([9 * np.sin(angle), 10 - 9 * np.cos(angle), 0 * angle], axis=1)),
    }
    offset = np.array([450_000.0, 5_400_000.0, 30.0])
    lines = []
    for robot, poses in truth.items():
        for n, T in enumerate(poses):
            guess = T.copy()
            guess[:3, 3] += offset
            lines.append(f"VERTEX_SE3:QUAT {keys[robot] + n} {numbers(guess)}")
        lines += [
            f"EDGE_SE3:QUAT {keys[robot] + n} {keys[robot] + n + 1}"
            f" {numbers(se3.between(poses[n], poses[n + 1]) @ se3.exp(rng.normal(size=6) * SIGMA))} {INFORMATION}"
            for n in range(29)
        ]
    lines += [
        f"EDGE_SE3:QUAT {keys['a'] + i} {keys['b'] + j}"
        f" {numbers(se3.between(truth['a'][i], truth['b'][j]) @ se3.exp(rng.normal(size=6) * SIGMA))} {INFORMATION}"
        for i, j in rng.integers(0, 30, (8, 2))
    ]
    lines.append(f"EDGE_SE3:QUAT {keys['a']} {keys['b'] + 99} {numbers(np.eye(4))} {INFORMATION}")
    path = tmp_path_factory.mktemp("graph") / "team.g2o"
    path.write_text("\n".join(lines))
    return path, truth, offset


@pytest.fixture(scope="module")
def merged(graph):
    return merge_graphs([graph[0]], Config())


def test_the_estimate_has_the_coordinates_of_the_files(graph, merged):
    _, truth, offset = graph
    found = merged.graph.trajectories["a"].poses
    np.testing.assert_allclose(found[0, :3, 3], offset, atol=1e-6)
    apart = se3.between(found[20], merged.graph.trajectories["b"].poses[20])
    np.testing.assert_allclose(apart[:3, 3], se3.between(truth["a"][20], truth["b"][20])[:3, 3], atol=0.3)
    assert merged.name(KeyframeId("b", 7)) == "b7"
    assert merged.seconds > 0


def test_sentences_of_all_stages_are_the_diagnosis(merged):
    assert merged.diagnosis == (*merged.team.warnings, *merged.consistent.diagnosis, *merged.graph.diagnosis)


def test_settings_of_the_user_go_before_those_for_graphs(graph):
    config = Config.model_validate({"pcm": {"min_clique_size": 9}})
    assert merge_graphs([graph[0]], config).graph.components == (("a",), ("b",))


def test_the_summary_counts_every_closure_and_the_files_hold_it(merged, tmp_path):
    found = summary(merged)
    assert (found["robots"], found["components"]) == ({"a": 30, "b": 30}, [["a", "b"]])
    assert (found["closures"]["read"], found["closures"]["accepted"]) == (9, 8)
    assert [row["reason"] for row in found["closures"]["rejected"]] == ["no file has a vertex b99"]
    assert "labels" not in found
    write_merged(tmp_path, merged)
    assert {path.name for path in tmp_path.iterdir()} == {
        "graph.g2o", "closures.csv", "summary.json", "a.tum", "b.tum", "a_kitti.txt", "b_kitti.txt"
    }  # fmt: skip
    assert len((tmp_path / "closures.csv").read_text().splitlines()) == 10
