"""`wiclosure optimize` on graphs of any form: the forms themselves are those of the reader's tests."""

from __future__ import annotations

import importlib.util
import json
import lzma
import sys
from pathlib import Path

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.graph_files.team import read_graphs
from wiclosure.formats.trajectories.tum import read_tum
from wiclosure.pipeline import cli

FALSE = se3.from_yaw(2.0, np.array([15.0, -9.0, 0.0]))


@pytest.fixture(scope="session")
def forms():
    """The writers of the reader's tests: test folders are no packages."""
    path = Path(__file__).parents[2] / "backends/graph_files/conftest.py"
    spec = importlib.util.spec_from_file_location("graph_forms", path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["graph_forms"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    def command(*words, out="out"):
        monkeypatch.setattr(
            sys, "argv", ["wiclosure", "optimize", *map(str, words), "--out", str(tmp_path / out), "--json"]
        )
        with pytest.raises(SystemExit) as ended:
            cli.main()
        printed = capsys.readouterr()
        return ended.value.code, json.loads(printed.out) if ended.value.code == 0 else None, printed.err

    return command


@pytest.fixture
def team(forms):
    """Two robots with true loops, and a false one from the last pose of the first to the first of the second."""
    team = forms.random_team(11, 2, size=30, n_loops=25)
    assert team.loops[0][:2] == ((0, 29), (1, 0))
    team.loops[0] = (*team.loops[0][:2], FALSE)
    return team


def accepted_of(found):
    """How many closures were accepted of how many, and whether the false one is among the rejected."""
    closures = found["closures"]
    far = max(closures["rejected"], key=lambda row: row["residual_m"] or 0.0)
    return closures["accepted"], closures["read"], far


@pytest.mark.parametrize("form", ["labelled", "symbols", "interleaved", "blocks"])
def test_a_false_loop_from_last_to_first_pose_is_never_odometry(run, forms, team, tmp_path, form):
    keys = {"labelled": forms.labelled, "symbols": forms.symbols, "interleaved": forms.interleaved(team, 1)}
    paths = forms.write(tmp_path, forms.lines(team, keys.get(form, forms.blocks(team))))
    code, found, _ = run(*paths)
    assert code == 0
    assert list(found["robots"].values()) == [30, 30]
    accepted, read, far = accepted_of(found)
    assert read == len(team.loops)
    assert accepted >= 0.8 * read
    assert len(found["components"]) == 1
    assert far["residual_m"] > 5


def test_edges_without_information_get_what_the_settings_say(run, forms, team, tmp_path):
    bare = [" ".join(line.split()[:10]) for of in forms.lines(team, forms.symbols) for line in of]
    (path,) = forms.write(tmp_path, [bare])
    code, found, err = run(path, "--set", "graphs.sigma_m=0.05", "--set", "graphs.sigma_rad=0.01")
    assert code == 0
    assert f"{58 + len(team.loops)} of {58 + len(team.loops)} edges state no information; 0.05 m and 0.01 rad" in err
    assert found["closures"]["accepted"] >= 0.5 * len(team.loops)
    assert read_graphs([path]).closures[0].measured.covariance == pytest.approx(np.eye(6))


def test_decimal_commas_are_called_so(run, forms, team, tmp_path):
    (path,) = forms.write(tmp_path, forms.lines(team, forms.symbols))
    path.write_text(path.read_text().replace(".", ","))
    code, _, err = run(path)
    assert code == 1
    assert "line 1: '0,0' has a decimal comma" in err
    assert len(err.splitlines()) == 1


def test_planar_graphs_are_solved_and_written_as_planar(run, forms, tmp_path):
    team = forms.random_team(4, 2, planar=True, size=25, n_loops=20)
    (path,) = forms.write(tmp_path, forms.lines(team, forms.blocks(team), "g2o-planar"))
    code, found, _ = run(path)
    assert code == 0
    assert len(found["components"]) == 1
    merged = tmp_path / "out/graph.g2o"
    assert {line.split()[0] for line in merged.read_text().splitlines()} <= {"VERTEX_SE2", "EDGE_SE2", "#", "FIX"}
    again = read_graphs([merged])
    assert [len(t) for t in again.odometry.values()] == [25, 25]
    assert len(again.closures) == found["closures"]["accepted"]
    trajectory = read_tum(tmp_path / "out/robot0.1.tum", "b")
    np.testing.assert_allclose(trajectory.positions[:, 2], 0.0, atol=1e-9)


def test_coordinates_of_a_map_come_back_with_all_their_digits(run, forms, team, tmp_path):
    far = se3.from_yaw(0.4, np.array([448_262.125, 5_411_932.678, 251.5]))
    near = [se3.from_yaw(0.4, np.zeros(3)), np.eye(4)]
    starts = {"near": near, "far": [far, se3.from_yaw(0.0, far[:3, 3])]}
    found = {}
    for name, of_robots in starts.items():
        (tmp_path / name).mkdir()
        paths = forms.write(tmp_path / name, forms.lines(team, forms.symbols, starts=of_robots))
        code, found[name], _ = run(*paths, out=f"out_{name}")
        assert code == 0
    assert found["far"]["closures"]["accepted"] == found["near"]["closures"]["accepted"]
    assert found["far"]["components"] == [["a", "b"]]
    for robot in "ab":
        at_far, at_near = (read_tum(tmp_path / f"out_{name}/{robot}.tum", robot).positions for name in ("far", "near"))
        np.testing.assert_allclose(at_far - far[:3, 3], at_near, atol=1e-6)
    again = read_graphs([tmp_path / "out_far/graph.g2o"])
    np.testing.assert_allclose(again.origins["a"], far[:3, 3], atol=1e-6)


def test_labels_of_a_robot_log_are_judged_and_results_written(run, forms, team, tmp_path):
    (tmp_path / "team.jrl").write_text(json.dumps(forms.robot_log(team, false={0})))
    code, found, _ = run(tmp_path / "team.jrl")
    assert code == 0
    labels = found["labels"]
    assert (labels["true"], labels["false"], labels["accepted_false"]) == (len(team.loops) - 1, 1, 0)
    assert labels["precision"] == 1.0
    assert labels["recall"] == pytest.approx(found["closures"]["accepted"] / (len(team.loops) - 1))
    results = json.loads((tmp_path / "out/results.jrr").read_text())
    assert [29, 0] in results["outliers"]["a"]
    assert {robot: len(values) for robot, values in results["solutions"].items()} == {"a": 30, "b": 30}


def test_indefinite_matrices_are_refused_once_or_repaired(run, forms, team, tmp_path):
    (path,) = forms.write(tmp_path, forms.lines(team, forms.symbols))
    lines = path.read_text().splitlines()
    edges = [n for n, line in enumerate(lines) if line.startswith("EDGE")]
    for n in edges[::3]:
        words = lines[n].split()
        lines[n] = " ".join([*words[:10], f"-{words[10]}", *words[11:]])
    path.write_text("\n".join(lines))
    code, _, err = run(path)
    assert code == 1
    assert f"{len(edges[::3])} of {len(edges)} information matrices are not positive semi-definite" in err
    assert len(err.splitlines()) == 1
    code, found, err = run(path, "--set", "graphs.indefinite=repair")
    assert code == 0
    assert f"indefinite; its negative axes are taken as unknown (and {len(edges[::3]) - 1} more" in err
    assert [len(group) for group in found["components"]] in ([2], [1, 1])


def test_packed_graphs_are_read(run, forms, tmp_path):
    team = forms.random_team(2, 1, size=30, n_loops=10)
    (path,) = forms.write(tmp_path, forms.lines(team, forms.blocks(team)))
    (tmp_path / "packed.g2o.xz").write_bytes(lzma.compress(path.read_bytes()))
    code, found, _ = run(tmp_path / "packed.g2o.xz")
    assert code == 0
    assert found["robots"] == {"packed": 30}
    (tmp_path / "cut.g2o.xz").write_bytes(lzma.compress(path.read_bytes())[:-40])
    code, _, err = run(tmp_path / "cut.g2o.xz", out="other")
    assert code == 1
    assert "cannot unpack" in err


def test_what_is_not_used_is_counted(run, forms, tmp_path):
    team = forms.random_team(2, 1, size=30, n_loops=10)
    (path,) = forms.write(tmp_path, forms.lines(team, forms.blocks(team)))
    path.write_text("FIX 0\n# a comment\n% another\nVERTEX_XYZ 5 1 2 3\nVERTEX_XYZ 6 1 2 3\n" + path.read_text())
    code, found, err = run(path)
    assert code == 0
    assert found["ignored"] == {"FIX": 1, "comment": 2, "VERTEX_XYZ": 2}
    assert "line 4: 'VERTEX_XYZ' is no kind of line known here; ignored (and 1 more like it)" in err


@pytest.mark.parametrize("folder", ["4robots", "9robots", "example_4robots"])
def test_recorded_lattices_are_one_map(run, data_dir, folder):
    paths = sorted((data_dir / f"pose_graphs/distributed_mapper/{folder}").glob("[0-9].g2o"))
    code, found, _ = run(*paths)
    assert code == 0
    assert list(found["robots"]) == list("abcdefghi"[: len(paths)])
    assert len(found["components"]) == 1
    assert found["closures"]["accepted"] >= 0.8 * found["closures"]["read"]


def test_both_copies_of_a_rejected_loop_are_outliers(run, forms, team, tmp_path):
    log = forms.robot_log(team, false={0})
    loop = next(m for m in log["measurements"]["a"][29]["measurements"])
    log["measurements"]["b"][5]["measurements"].append(loop)
    (tmp_path / "team.jrl").write_text(json.dumps(log))
    code, _, _ = run(tmp_path / "team.jrl")
    assert code == 0
    outliers = json.loads((tmp_path / "out/results.jrr").read_text())["outliers"]
    assert [29, 0] in outliers["a"]
    assert [5, 1] in outliers["b"]
