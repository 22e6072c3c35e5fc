from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.backends.graph_files.jrr_writer import METHOD, write_robot_results
from wiclosure.errors import OutputError


@pytest.mark.parametrize("planar", [False, True])
@given(seed=st.integers(0, 10**6))
def test_every_pose_stands_with_its_key_in_the_values_of_a_robot_log(tmp_path_factory, forms, planar, seed):
    team = forms.random_team(seed, 2, planar=planar)
    poses = dict(zip("ab", team.chained([np.eye(4)] * 2), strict=True))
    keys = {
        robot: np.array([forms.symbols(r, n) for n in range(len(poses[robot]))], np.uint64)
        for r, robot in enumerate("ab")
    }
    path = tmp_path_factory.mktemp("results") / "r.jrr"
    write_robot_results(path, "random", poses, keys, [("b", 4, 1), ("b", 2, 0)], planar=planar)
    results = json.loads(path.read_text())
    assert (results["dataset_name"], results["method_name"]) == ("random", METHOD)
    assert results["robots"] == [ord("a"), ord("b")]
    assert results["outliers"] == {"a": [], "b": [[2, 0], [4, 1]]}
    for r, robot in enumerate("ab"):
        assert len(results["solutions"][robot]) == len(poses[robot])
        for n, (found, T) in enumerate(zip(results["solutions"][robot], poses[robot], strict=True)):
            expected = forms.value(T, planar=planar)
            assert (found.pop("key"), found["type"]) == (forms.symbols(r, n), expected["type"])
            if planar:
                assert found == expected
            else:
                np.testing.assert_array_equal(found["translation"], expected["translation"])
                assert abs(np.dot(found["rotation"], expected["rotation"])) == pytest.approx(1.0)


def test_a_robot_of_the_estimate_that_the_log_calls_otherwise_is_sorted_by_its_key(tmp_path, forms):
    keys = {"a.1": np.array([forms.symbols(0, 5), forms.symbols(1, 0)], np.uint64)}
    write_robot_results(tmp_path / "r.jrr", "t", {"a.1": np.tile(np.eye(4), (2, 1, 1))}, keys, [])
    solutions = json.loads((tmp_path / "r.jrr").read_text())["solutions"]
    assert {robot: [value["key"] for value in values] for robot, values in solutions.items()} == {
        "a": [forms.symbols(0, 5)],
        "b": [forms.symbols(1, 0)],
    }


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(OutputError, match=r"cannot write .*r\.jrr: No such file or directory; choose another folder"):
        write_robot_results(tmp_path / "none" / "r.jrr", "t", {}, {}, [])
