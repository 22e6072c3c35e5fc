from __future__ import annotations

import json

import numpy as np
import pytest

from wiclosure.backends.graph_files.jrl import _information
from wiclosure.backends.graph_files.team import read_graphs
from wiclosure.errors import InputError


@pytest.fixture
def log(forms):
    """A random team as a robot log, which tests may change, and a function that reads it."""
    team = forms.random_team(3, 2)
    return team, forms.robot_log(team, false={1})


def read(content, folder, name="log.jrl"):
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return read_graphs([path])


def test_labels_come_with_the_loops(log, tmp_path):
    written, content = log
    team = read(content, tmp_path)
    assert team.from_robot_log
    assert team.title == "random"
    false = [edge.is_false for edge in team.edges]
    assert false.count(True) == 1
    assert len(false) == len(written.loops)
    assert {edge.factor[0] for edge in team.edges} <= {"a", "b"}
    listed = {(robot, *pair) for robot, pairs in content["outlier_factors"].items() for pair in pairs}
    assert {edge.factor for edge in team.edges if edge.is_false} == listed


def test_loops_that_may_be_false_are_no_odometry(log, tmp_path):
    _, content = log
    steps = content["measurements"]["a"]
    step = steps[1]["measurements"].pop()
    steps[-1]["measurements"].append(step)  # now said to be a loop
    content["potential_outlier_factors"]["a"].append([len(steps) - 1, len(steps[-1]["measurements"]) - 1])
    odometry = read(content, tmp_path).odometry
    assert len(odometry["a"]) == len(steps)  # nothing else holds the robot together
    other = {**step, "key1": step["key1"], "key2": step["key2"] + 1}
    steps[0]["measurements"].append(other)
    assert read(content, tmp_path).odometry["a"].parents is not None  # and now something else does


def test_what_is_no_relative_pose_is_counted(log, tmp_path, forms):
    _, content = log
    first = content["measurements"]["a"][0]["measurements"]
    first += [{"type": "RangeFactorPose3"}, {"type": "PriorFactorPoint3"}, {"type": "RangeFactorPose3"}]
    assert read(content, tmp_path).ignored == {"RangeFactorPose3": 2, "PriorFactorPoint3": 1}


def test_the_first_guess_is_where_a_robot_starts(log, tmp_path, forms):
    _, content = log
    at = forms.value(np.array([[1.0, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]))
    content["initialization"] = {"b": [{**at, "key": forms.symbols(1, 0)}, {"type": "Point3", "key": 5}]}
    team = read(content, tmp_path)
    np.testing.assert_allclose(team.odometry["b"].positions[0], [5, 6, 7])
    assert team.ignored == {"Point3": 1}
    assert any("no pose is given for a0; a starts at the origin" in sentence for sentence in team.warnings)


def test_a_prior_is_where_a_robot_starts_if_the_log_has_no_first_guess(log, tmp_path, forms):
    _, content = log
    at = forms.value(np.array([[1.0, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]))
    prior = {"type": "PriorFactorPose3", "key": forms.symbols(0, 0), "prior": at, "covariance": [1.0] * 36}
    content["measurements"]["a"][0]["measurements"].append(prior)
    team = read(content, tmp_path)
    np.testing.assert_allclose(team.odometry["a"].positions[0], [5, 6, 7])
    assert not team.ignored


@pytest.mark.parametrize("unlabelled", ["potential_outlier_factors", "outlier_factors"])
def test_labels_may_be_missing(log, tmp_path, unlabelled):
    written, content = log
    del content[unlabelled]
    team = read(content, tmp_path)
    assert len(team.closures) == len(written.loops)
    if unlabelled == "outlier_factors":
        assert {edge.is_false for edge in team.edges} == {None}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: "", "not valid JSON"),
        (lambda c: json.dumps(c)[:-30], "not valid JSON.*; the file is cut"),
        (lambda c: "[" * 100_000, "nested deeper"),
        (lambda c: [], "has no measurements by robot"),
        (
            lambda c: c | {"measurements": {"a": [{"measurements": [{}]}]}},
            "robot a, entry 0, measurement 0: 'type' is missing",
        ),
        (
            lambda c: c | {"outlier_factors": [[0, 1]]},
            "outlier_factors names no robots, and there are 2; expected lists",
        ),
        (lambda c: c | {"initialization": {"a": [[]]}}, "initialization of a: .* a JSON Robot Log has it otherwise"),
        (lambda c: c | {"measurements": {"a": []}}, "no poses in it"),
    ],
)
def test_what_is_no_robot_log_is_refused_in_one_line(log, tmp_path, change, message):
    with pytest.raises(InputError, match=message) as refused:
        read(change(log[1]), tmp_path)
    assert "\n" not in str(refused.value)


def test_logs_packed_as_cbor_are_read(log, tmp_path):
    cbor2 = pytest.importorskip("cbor2")
    written, content = log
    path = tmp_path / "log.jrl.cbor"
    path.write_bytes(cbor2.dumps(content))
    assert len(read_graphs([path]).closures) == len(written.loops)
    path.write_bytes(cbor2.dumps(content)[:-20])
    with pytest.raises(InputError, match="the file is cut"):
        read_graphs([path])


def test_a_covariance_of_the_largest_numbers_tells_nothing() -> None:
    assert not (_information((np.eye(6) * 1.7e308).ravel().tolist(), planar=False) > 0).any()


def test_values_by_key_and_labels_without_robots_are_read_as_the_description_has_them(forms, tmp_path):
    team = forms.random_team(3, 1, size=12, n_loops=8)
    content = forms.robot_log(team, false={1})
    at = forms.value(np.array([[1.0, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]))
    content["initialization"] = {"a": {str(forms.symbols(0, 0)): at}}
    listed = content["outlier_factors"]["a"]
    for word in ("outlier_factors", "potential_outlier_factors"):
        content[word] = content[word]["a"]
    found = read(content, tmp_path)
    np.testing.assert_allclose(found.odometry["a"].positions[0], [5, 6, 7])
    assert [list(edge.factor[1:]) for edge in found.edges if edge.is_false] == listed


def test_a_robot_of_which_only_loops_tell_has_no_poses(log, tmp_path):
    written, content = log
    content["measurements"] = {"a": content["measurements"]["a"]}
    found = read(content, tmp_path)
    assert list(found.odometry) == ["a"]
    assert len(found.unusable) == sum({q[0], m[0]} == {0, 1} for q, m, _ in written.loops if q[0] == 0)


def test_logs_of_one_robot_each_are_a_team_and_each_tells_its_own_starts(log, forms, tmp_path):
    written, content = log
    at = forms.value(np.array([[1.0, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]))
    paths = []
    for r, robot in enumerate("ab"):
        starts = {robot: [{**at, "key": forms.symbols(r, 0)}]}
        alone = content | {"measurements": {robot: content["measurements"][robot]}, "initialization": starts}
        paths.append(tmp_path / f"{robot}.jrl")
        paths[-1].write_text(json.dumps(alone))
    found = read_graphs(paths)
    assert len(found.closures) == len(written.loops)
    for robot in "ab":
        np.testing.assert_allclose(found.odometry[robot].positions[0], [5, 6, 7])
    assert not found.warnings
