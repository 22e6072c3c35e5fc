from __future__ import annotations

import numpy as np
import pytest

from wiclosure.drift import DriftModel
from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.data.named_trajectories import named_trajectories
from wiclosure.types import Trajectory


@pytest.fixture
def files(tmp_path):
    """Two robots along x, a metre a second; the name of one file has an equals sign in it."""
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = np.arange(3)
    paths = {"alpha": tmp_path / "alpha.tum", "beta": tmp_path / "run=2.tum"}
    for robot, path in paths.items():
        write_tum(path, Trajectory(robot, 10**18 + np.arange(3) * 10**9, poses))
    return paths


def test_each_robot_has_the_trajectory_of_its_file(files):
    drift = DriftModel()
    found = named_trajectories([f"{robot}={path}" for robot, path in files.items()], drift)
    assert list(found) == ["alpha", "beta"]
    assert [trajectory.robot for trajectory in found.values()] == ["alpha", "beta"]
    np.testing.assert_array_equal(found["beta"].positions[:, 0], [0, 1, 2])
    assert found["beta"].drift is drift


@pytest.mark.parametrize("word", ["alpha.tum", "=alpha.tum", "alpha=", ""])
def test_another_form_is_refused(word):
    with pytest.raises(ConfigError, match=r"expected NAME=FILE, for example alpha=alpha\.tum"):
        named_trajectories([word])


def test_a_robot_twice_is_refused(files):
    with pytest.raises(ConfigError, match="names alpha twice"):
        named_trajectories([f"alpha={files['alpha']}", f"alpha={files['beta']}"])


def test_one_robot_is_not_enough(files):
    with pytest.raises(ConfigError, match="one trajectory only"):
        named_trajectories([f"alpha={files['alpha']}"])


def test_a_file_that_is_not_there_is_named(files, tmp_path):
    with pytest.raises(InputError, match=r"gone\.tum"):
        named_trajectories([f"alpha={files['alpha']}", f"beta={tmp_path / 'gone.tum'}"])
