from __future__ import annotations

import csv
import json
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.graph_files.team import read_graphs
from wiclosure.formats.trajectories.tum import read_tum
from wiclosure.pipeline import cli
from wiclosure.pipeline.config import load_config
from wiclosure.pipeline.report.html.page import read_page

SIGMA = np.repeat([0.01, 0.05], 3)
INFORMATION = " ".join(map(str, np.diag(1 / np.roll(SIGMA, 3) ** 2)[np.triu_indices(6)]))  # translation first


def numbers(T):
    return " ".join(map(repr, [*T[:3, 3].tolist(), *Rotation.from_matrix(T[:3, :3]).as_quat().tolist()]))


@pytest.fixture
def graphs(tmp_path):
    """Two robots on arcs through one place, ten true closures between them and two false ones."""
    rng = np.random.default_rng(0)
    keys = {robot: ord(robot) << 56 for robot in "ab"}
    angle = np.linspace(0, 3, 40)
    truth = {
        "a": se3.from_yaw(angle, np.stack([10 * np.sin(angle), 10 - 10 * np.cos(angle), 0 * angle], axis=1)),
        "b": se3.from_yaw(angle + 1, np.stack([9 * np.sin(angle), 10 - 9 * np.cos(angle), 0 * angle], axis=1)),
    }

    def noise():
        return se3.exp(rng.normal(size=6) * SIGMA)

    loops = [
        f"EDGE_SE3:QUAT {keys['a'] + i} {keys['b'] + j} {numbers(se3.between(truth['a'][i], truth['b'][j]) @ noise())}"
        f" {INFORMATION}"
        for i, j in rng.integers(0, 40, (10, 2))
    ]
    loops += [
        f"EDGE_SE3:QUAT {keys['a'] + i} {keys['b'] + j} {numbers(se3.from_yaw(2.0, np.array([i, j, 0.0])))}"
        f" {INFORMATION}"
        for i, j in ((5, 30), (20, 10))
    ]
    paths = []
    for robot, poses in truth.items():
        lines = [f"VERTEX_SE3:QUAT {keys[robot] + n} {numbers(np.eye(4))}" for n in range(40)]
        lines += [
            f"EDGE_SE3:QUAT {keys[robot] + n} {keys[robot] + n + 1}"
            f" {numbers(se3.between(poses[n], poses[n + 1]) @ noise())} {INFORMATION}"
            for n in range(39)
        ]
        paths.append(tmp_path / f"{robot}.g2o")
        paths[-1].write_text("\n".join([*lines, *loops]) + "\n")
    return paths, truth


def run(monkeypatch, capsys, *words):
    monkeypatch.setattr(sys, "argv", ["wiclosure", "optimize", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code, capsys.readouterr()


def test_two_graphs_become_one_without_the_false_closures(graphs, tmp_path, monkeypatch, capsys):
    paths, truth = graphs
    out = tmp_path / "merged"
    code, printed = run(monkeypatch, capsys, *paths, "--out", out, "--json")
    assert code == 0
    found = json.loads(printed.out)
    assert found == json.loads((out / "summary.json").read_text())
    assert load_config(str(out / "config.yaml")) == load_config()  # what the page says to run again with
    assert found["components"] == [["a", "b"]]
    assert found["closures"]["accepted"] == 10
    assert [(row["first"], row["second"]) for row in found["closures"]["rejected"]] == [("a5", "b30"), ("a20", "b10")]
    assert found["closures"]["rejected"][0]["residual_m"] > 5
    with (out / "closures.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["decision"] for row in rows] == ["accepted"] * 10 + ["rejected"] * 2
    a, b = (read_tum(out / f"{robot}.tum", robot) for robot in "ab")
    apart = se3.between(a.poses[20], b.poses[20])[:3, 3] - se3.between(truth["a"][20], truth["b"][20])[:3, 3]
    assert np.linalg.norm(apart) < 0.3
    assert len((out / "a_kitti.txt").read_text().splitlines()) == 40
    (page,) = read_page(out / "report.html")["runs"]
    assert sum(closure["decision"] == "rejected" for closure in page["closures"]) == 2


def test_the_graph_that_is_written_has_the_keys_of_the_one_that_was_read(graphs, tmp_path, monkeypatch, capsys):
    paths, _ = graphs
    run(monkeypatch, capsys, *paths, "--out", tmp_path / "merged", "--quiet")
    before, after = read_graphs(paths), read_graphs([tmp_path / "merged/graph.g2o"])
    assert {r: k.tolist() for r, k in before.keys.items()} == {r: k.tolist() for r, k in after.keys.items()}
    assert len(after.closures) == 10


def test_the_table_names_what_was_rejected_and_why(graphs, tmp_path, monkeypatch, capsys):
    paths, _ = graphs
    _, printed = run(monkeypatch, capsys, *paths, "--out", tmp_path / "merged")
    assert "10 of 12 accepted" in printed.out
    assert "a5 - b30" in printed.out


def test_settings_of_the_user_go_before_those_for_graphs(graphs, tmp_path, monkeypatch, capsys):
    paths, _ = graphs
    words = ["--set", "pose_graph.anchor=b", "--set", "pcm.min_clique_size=11", "--json"]
    _, printed = run(monkeypatch, capsys, *paths, "--out", tmp_path / "merged", *words)
    found = json.loads(printed.out)
    assert found["components"] == [["b"], ["a"]]
    assert found["closures"]["accepted"] == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no poses in it"),
        ("VERTEX_SE3:QUAT 1 0 0 nan 0 0 0\n", "expected 8 fields"),
    ],
)
def test_bad_graphs_end_in_one_line(tmp_path, monkeypatch, capsys, text, message):
    path = tmp_path / "bad.g2o"
    path.write_text(text)
    code, printed = run(monkeypatch, capsys, path, "--out", tmp_path / "merged")
    assert code == 1
    assert message in printed.err
    assert len(printed.err.splitlines()) == 1
    assert not (tmp_path / "merged").exists()


def test_unusable_closures_are_in_the_table_and_the_rest_is_merged(graphs, tmp_path, monkeypatch, capsys):
    paths, _ = graphs
    unknown = f"EDGE_SE3:QUAT {ord('a') << 56} {(ord('b') << 56) + 99} {numbers(np.eye(4))} {INFORMATION}\n"
    paths[0].write_text(paths[0].read_text() + unknown)
    code, printed = run(monkeypatch, capsys, *paths, "--out", tmp_path / "merged", "--json")
    assert code == 0
    assert json.loads(printed.out)["closures"]["rejected"][-1]["reason"] == "no file has a vertex b99"
    assert "left out, no file has a vertex b99" in printed.err
