from __future__ import annotations

import gtsam
import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.config import ClosureNoise, PoseGraphSettings
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.graph_files.g2o_writer import PLANAR, SPATIAL, write_g2o
from wiclosure.backends.graph_files.team import read_graphs
from wiclosure.errors import OutputError

TIGHT = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)


def test_what_is_written_is_read_again_and_gives_the_same_estimate(team_maker, tmp_path):
    team, rng = team_maker(8, noise=1.0), np.random.default_rng(8)
    result = optimise(team.odometry, team.random_closures(8, rng, noise=rng), PoseGraphSettings(noise=TIGHT))
    write_g2o(result, tmp_path / "graph.g2o")
    again = read_graphs([tmp_path / "graph.g2o"])
    assert again.warnings == again.unusable == ()
    second = optimise(again.odometry, again.closures, PoseGraphSettings(noise=TIGHT))
    for robot, trajectory in result.trajectories.items():
        np.testing.assert_allclose(second.trajectories[robot].poses, trajectory.poses, atol=1e-4)


def test_every_closure_is_there_with_its_fate(team_maker, tmp_path):
    team, rng = team_maker(2, noise=1.0), np.random.default_rng(2)
    false = [team.false_closure(("alpha", 5), ("beta", 50), rng)]
    result = optimise(team.odometry, team.random_closures(20, rng, noise=rng) + false, PoseGraphSettings())
    write_g2o(result, tmp_path / "graph.g2o")
    lines = (tmp_path / "graph.g2o").read_text().splitlines()
    fates = [lines[n - 1].split(":")[0] for n, line in enumerate(lines) if "EDGE" in line and lines[n - 1][0] == "#"]
    assert fates.count("# accepted") == len(result.accepted)
    assert fates.count("# rejected") == 21 - len(result.accepted)
    assert any(line.startswith("# rejected: contradicts the joint estimate") for line in lines)
    assert lines[-1].startswith("# EDGE_SE3:QUAT 5 110 ")


def test_g2o_round_trip_through_gtsam(team_maker, tmp_path):
    team, rng = team_maker(8, ("alpha", "beta", "gamma"), 20, noise=1.0), np.random.default_rng(8)
    far = {r: t.moved(se3.from_yaw(0.3, np.array([12345.678, 0.0, 0.0]))) for r, t in team.odometry.items()}
    result = optimise(far, team.random_closures(5, rng, noise=rng), PoseGraphSettings())
    write_g2o(result, tmp_path / "graph.g2o")
    graph, values = gtsam.readG2o(str(tmp_path / "graph.g2o"), is3D=True)
    assert graph.size() == 3 * 19 + len(result.accepted)
    assert values.size() == 60
    for robot, trajectory in enumerate(result.trajectories.values()):
        read = np.stack([values.atPose3(20 * robot + n).matrix() for n in range(20)])
        np.testing.assert_allclose(read, trajectory.poses, atol=1e-9)
    factors = [result.graph.at(i) for i in range(result.graph.size())]
    expected = sum(f.error(result.values) for f in factors if isinstance(f, gtsam.BetweenFactorPose3))
    assert graph.error(values) == pytest.approx(expected, rel=1e-6)


def test_g2o_numbers_fit_32_bits_and_say_whose_they_are(team_maker, tmp_path):
    odometry = team_maker(9, ("alpha", "beta"), 3).odometry
    write_g2o(optimise(odometry, [], PoseGraphSettings()), tmp_path / "graph.g2o")
    lines = (tmp_path / "graph.g2o").read_text().splitlines()
    assert lines[:2] == ["# keyframes of alpha: vertices 0 to 2", "# keyframes of beta: vertices 3 to 5"]
    words = [line.split() for line in lines]
    assert [int(w[1]) for w in words if w[0] == "VERTEX_SE3:QUAT"] == [0, 1, 2, 3, 4, 5]
    assert [(int(w[1]), int(w[2])) for w in words if w[0] == "EDGE_SE3:QUAT"] == [(0, 1), (1, 2), (3, 4), (4, 5)]
    assert [w for w in words if w[0] == "FIX"] == [["FIX", "0"], ["FIX", "3"]], "one of each group that hangs together"


@pytest.mark.parametrize("form", ["symbols", "labelled", "interleaved", "toro3", "planar", "toro2", "robot log"])
@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_keys_measurements_and_matrices_are_written_as_they_were_read(forms, tmp_path, form, scale):
    _, paths = forms.written(form, 11, tmp_path, robots=3)
    team = read_graphs(paths)
    result = optimise(team.odometry, team.closures, PoseGraphSettings(noise=TIGHT, sigma_scale=scale))
    write_g2o(result, tmp_path / "out.g2o", team.keys, PLANAR if team.planar else SPATIAL, team.unnamed)
    again = read_graphs([tmp_path / "out.g2o"])
    assert {name: keys.tolist() for name, keys in again.keys.items()} == {
        name: keys.tolist() for name, keys in team.keys.items()
    }
    for name, odometry in team.odometry.items():
        n = np.arange(len(odometry) - 1)
        found = again.odometry[name]
        np.testing.assert_allclose(found.relative_pose(n, n + 1), odometry.relative_pose(n, n + 1), atol=1e-9)
        np.testing.assert_allclose(found.step_covariances, odometry.step_covariances, rtol=1e-6, atol=1e-12)
    axes = np.array([2, 3, 4] if team.planar else range(6))
    closures = {frozenset((c.query, c.match)): c for c in team.closures}
    for closure in again.closures:
        read = closures[frozenset((closure.query, closure.match))]
        T, covariance = read.measured.T_query_match, read.measured.covariance
        if read.query != closure.query:  # the same from the other end
            T, covariance = se3.inverse(T), se3.inverse_covariance(T, covariance)
        np.testing.assert_allclose(closure.measured.T_query_match, T, atol=1e-9)
        found_covariance = closure.measured.covariance[np.ix_(axes, axes)]
        np.testing.assert_allclose(found_covariance, covariance[np.ix_(axes, axes)], rtol=1e-6, atol=1e-12)
    assert len(again.closures) == len(result.accepted)


def test_g2o_into_a_missing_folder_says_where(team_maker, tmp_path):
    result = optimise(team_maker(9, n=3).odometry, [], PoseGraphSettings())
    with pytest.raises(OutputError, match="nowhere"):
        write_g2o(result, tmp_path / "nowhere" / "graph.g2o")
