from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.graph_files.team import read_graphs
from wiclosure.errors import InputError
from wiclosure.types import KeyframeId

A, B = (ord(letter) << 56 for letter in "ab")
UNIT = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"
AHEAD = "1 0 0 0 0 0 1"


def vertex(key, pose="0 0 0 0 0 0 1"):
    return f"VERTEX_SE3:QUAT {key} {pose}"


def edge(first, second, pose=AHEAD, information=UNIT):
    return f"EDGE_SE3:QUAT {first} {second} {pose} {information}"


CHAIN_A = [vertex(A), vertex(A + 1), vertex(A + 2), edge(A, A + 1), edge(A + 1, A + 2)]
CHAIN_B = [vertex(B + 5, "9 0 0 0 0 0 1"), vertex(B + 7), edge(B + 5, B + 7)]


@pytest.fixture
def read(tmp_path):
    def of_lines(*files):
        paths = []
        for number, lines in enumerate(files):
            paths.append(tmp_path / f"{number}.g2o")
            paths[-1].write_text("\n".join(lines) + "\n")
        return read_graphs(paths)

    return of_lines


def test_symbols_name_the_robots_and_keys_may_skip(read):
    team = read(CHAIN_A, [*CHAIN_B, edge(A + 2, B + 7)])
    assert list(team.odometry) == ["a", "b"]
    np.testing.assert_allclose(team.odometry["a"].positions[:, 0], [0, 1, 2])
    np.testing.assert_allclose(team.odometry["b"].positions[:, 0], [9, 10])
    assert team.indices["b"].tolist() == [5, 7]
    assert team.keys["b"].tolist() == [B + 5, B + 7]
    assert [(c.query.index, c.match.index) for c in team.closures] == [(2, 1)]
    assert team.warnings == team.unusable == ()


def test_information_is_turned_into_covariance_rotation_first(read):
    information = "4 0 0 0 0 0 4 0 0 0 0 4 0 0 0 100 0 0 100 0 100"
    team = read([*CHAIN_A, *CHAIN_B, edge(A, B + 5, AHEAD, information)])
    np.testing.assert_allclose(team.closures[0].measured.covariance, np.diag([0.01] * 3 + [0.25] * 3))
    np.testing.assert_allclose(team.odometry["a"].step_covariances, np.stack([np.eye(6)] * 2))


def test_closures_in_both_robots_files_count_once(read):
    loop = edge(A, B + 5)
    team = read([*CHAIN_A, loop], [*CHAIN_B, loop, edge(A, B + 5, "2 0 0 0 0 0 1")])
    assert [c.measured.T_query_match[0, 3] for c in team.closures] == [1.0, 2.0]
    assert team.places[0].endswith("0.g2o, line 6")


def test_odometry_may_be_written_backwards(read):
    team = read([vertex(A), vertex(A + 1), edge(A + 1, A, "-3 0 0 0 0 0 1")])
    np.testing.assert_allclose(team.odometry["a"].positions[:, 0], [0, 3])
    assert not team.closures


def test_plain_numbers_are_one_robot_a_file(read):
    plain = [vertex(0), vertex(1), edge(0, 1)]
    assert list(read(plain, plain).odometry) == ["0", "1"]


def test_what_cannot_be_used_is_named_and_the_rest_goes_on(read):
    bad = [
        edge(A, B + 6),
        edge(A, B + 5, "nan 0 0 0 0 0 1"),
        edge(A, B + 5, "1 0 0 0 0 0 0"),
        edge(A, B + 5, AHEAD, "-" + UNIT),
        edge(ord("z") << 56, B + 5),
    ]
    team = read([*CHAIN_A, *CHAIN_B, *bad, edge(A, B + 7)])
    assert len(team.closures) == 1
    assert [(u.first, u.second, u.reason) for u in team.unusable] == [
        ("a0", "b6", "no file has a vertex b6"),
        ("a0", "b5", "a number is not finite"),
        ("a0", "b5", "its quaternion is zero"),
        ("a0", "b5", "its information matrix is not positive semi-definite"),
        ("z0", "b5", "no file has a vertex z0"),
    ]
    assert team.unusable[0].place.endswith("0.g2o, line 9")


def test_the_rest_of_a_broken_odometry_is_another_robot(read):
    more = [vertex(A + 4), vertex(A + 5), edge(A + 4, A + 5), *CHAIN_B, edge(B + 5, A + 5)]
    team = read([*CHAIN_A, *more])
    assert {robot: len(t) for robot, t in team.odometry.items()} == {"a": 3, "a.1": 2, "b": 2}
    assert team.indices["a.1"].tolist() == [4, 5]
    assert team.closures[0].match == KeyframeId("a.1", 1)
    assert "none of its edges leads to a4; the rest is a.1" in team.warnings[0]


def test_another_edge_of_its_own_joins_a_robot_whose_odometry_is_broken(read):
    team = read([*CHAIN_A, vertex(A + 4), vertex(A + 5), edge(A + 4, A + 5), edge(A, A + 5, "0 1 0 0 0 0 1")])
    assert team.indices["a"].tolist() == [0, 1, 2, 5, 4]  # each pose after the one that leads to it
    np.testing.assert_allclose(team.odometry["a"].positions[:, :2], [[0, 0], [1, 0], [2, 0], [0, 1], [-1, 1]])
    assert not team.closures
    assert "1 other edges of its own join its 5 poses" in team.warnings[0]


def test_what_can_be_repaired_is_repaired_and_said(read):
    chain = [vertex(A, "nan 0 0 0 0 0 1"), vertex(A + 1), edge(A, A + 1, "1 0 0 0 0 0 2"), "0.42", vertex(A + 1, AHEAD)]
    team = read([*chain, edge(A, A + 1, "1.1 0 0 0 0 0 1", "1 " + "0 " * 20)])
    np.testing.assert_allclose(team.odometry["a"].positions[:, 0], [0, 1])
    assert np.linalg.eigvalsh(team.closures[0].measured.covariance)[-1] == pytest.approx(1e8)
    said = "\n".join(team.warnings)
    for part in ("line 4: '0.42'", "line 5: a1 stands already", "a starts at the origin", "length 2", "singular"):
        assert part in said


def test_a_habit_of_the_writer_is_said_once(read):
    loose = [edge(A + n, A + n + 1, f"1 0 0 0 0 0 {2 + n}") for n in range(20)]
    team = read([*(vertex(A + n) for n in range(21)), *loose])
    assert len(team.warnings) == 1
    assert "length 2; normalised (and 19 more like it)" in team.warnings[0]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "no poses in it"),
        ([vertex(A), edge(A, A + 1)[:-4]], "line 2: expected 9 or 30 fields after EDGE_SE3:QUAT, found 28"),
        ([vertex("key")], "line 1: the key 'key' is no whole number"),
        ([vertex(-3)], "line 1: a key must be a number from 0"),
        (
            [vertex(A), vertex(A + 1), edge(A, A + 1, "nan 0 0 0 0 0 1")],
            "line 3: odometry of a: a number is not finite",
        ),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_place(read, lines, message):
    with pytest.raises(InputError, match=message):
        read(lines)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="nowhere"):
        read_graphs([tmp_path / "nowhere.g2o"])


@settings(max_examples=50, deadline=None)
@given(
    text=st.lists(st.sampled_from([*CHAIN_A, *CHAIN_B, "EDGE_SE3:QUAT", "VERTEX_SE3:QUAT 1 a", "FIX 0", "\x00", "é"]))
)
def test_any_lines_are_read_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("any") / "0.g2o"
    path.write_text("\n".join(text))
    try:
        team = read_graphs([path])
    except InputError:
        return
    assert all(np.isfinite(t.poses).all() for t in team.odometry.values())


def test_recorded_graphs_are_read_whole(data_dir):
    team = read_graphs(sorted((data_dir / "pose_graphs/argos_spoiled/example_4robots").glob("*.g2o")))
    assert {robot: len(t) for robot, t in team.odometry.items()} == dict.fromkeys("abcd", 275)
    assert len(team.closures) == 44  # one stands in two files, in opposite directions
    np.testing.assert_allclose(se3.inverse(team.odometry["a"].poses[0]) @ team.odometry["a"].poses[0], np.eye(4))


PLANE = ["VERTEX_SE2 0 0 0 0", "VERTEX_SE2 1 1 0 0", "VERTEX_SE2 2 2 0 0.5"]


@pytest.mark.parametrize(
    ("tag", "swapped"), [("EDGE_SE2", False), ("EDGE2", True), ("EDGE_SE2", True), ("EDGE2", False)]
)
def test_the_order_of_planar_matrices_is_the_one_in_which_they_are_positive(read, tag, swapped):
    toro = (tag == "EDGE2") != swapped
    information = "4 0 25 100 1 0" if toro else "4 0 1 25 0 100"
    edges = [f"{tag} 0 1 1 0 0 {information}", f"{tag} 1 2 1 0 0.5 {information}", f"{tag} 0 2 2 0 0.5 {information}"]
    team = read([*PLANE, *edges])
    stated = np.linalg.inv(team.closures[0].measured.covariance[np.ix_([3, 4, 2], [3, 4, 2])])
    np.testing.assert_allclose(stated, [[4, 0, 1], [0, 25, 0], [1, 0, 100]], atol=1e-9)
    assert any("order of" in sentence for sentence in team.warnings) == swapped


@pytest.mark.parametrize("tag", ["EDGE_SE2_SWITCHABLE", "EDGE_SE2_MAXMIX"])
def test_loops_with_a_switch_or_a_weight_are_read_and_may_be_false(read, tag):
    steps = [f"EDGE_SE2 {n} {n + 1} 1 0 0 4 0 0 4 0 9" for n in (0, 1)]
    team = read(
        [*PLANE, *steps, "VERTEX_SWITCH 900 1", "EDGE_SWITCH_PRIOR 900 1 1", f"{tag} 0 2 900 2 0 0.5 4 0 0 4 0 9"]
    )
    np.testing.assert_allclose(team.closures[0].measured.T_query_match, se3.from_yaw(0.5, np.array([2.0, 0.0, 0.0])))
    assert team.edges[0].may_be_false
    assert team.warnings == ()
    assert team.ignored == {"VERTEX_SWITCH": 1, "EDGE_SWITCH_PRIOR": 1}


def test_spatial_loops_with_a_switch(read):
    team = read([*CHAIN_A, f"EDGE_SE3_SWITCHABLE {A} {A + 2} 7 2 0 0 0 0 0 1 {UNIT}"])
    np.testing.assert_allclose(team.closures[0].measured.T_query_match[:3, 3], [2, 0, 0])


def test_the_older_names_of_planar_lines(read):
    vertices = [line.replace("_SE2", "") for line in PLANE]
    team = read(
        [
            *vertices,
            "ODOMETRY 0 1 1 0 0 4 0 0 4 0 9",
            "ODOMETRY 1 2 1 0 0.5 4 0 0 4 0 9",
            "EDGE 0 2 2 0 0.5 4 0 4 9 0 0",
        ]
    )
    assert team.planar
    assert [len(t) for t in team.odometry.values()] == [3]
    assert len(team.closures) == 1


def test_a_measurement_and_its_inverse_are_one(read):
    there, back = "3 1 0 0 0 0.6 0.8", "-0.12 -3.16 0 0 0 -0.6 0.8"
    others = [*CHAIN_A, *CHAIN_B, edge(A, B + 5, there)]
    assert len(read([*others, edge(B + 5, A, back)]).closures) == 2  # not the inverse
    T = se3.inverse(read(others).closures[0].measured.T_query_match)
    assert len(read([*others, edge(B + 5, A, f"{T[0, 3]:.6f} {T[1, 3]:.6f} 0 0 0 -0.6 0.8")]).closures) == 1


def test_remarks_behind_a_line_are_passed_over(read):
    team = read([f"{line} # measured twice" for line in [*CHAIN_A, *CHAIN_B]])
    assert [len(path) for path in team.odometry.values()] == [3, 2]


@pytest.mark.parametrize("key", ["3.0", "a3", "0x3"])
def test_a_key_that_is_no_whole_number_is_named(read, key):
    with pytest.raises(InputError, match=rf"line 6: the key '{key}' is no whole number"):
        read([*CHAIN_A, vertex(key)])


def test_poses_without_edges_are_no_graph(read):
    with pytest.raises(InputError, match="3 poses and no edges; a pose graph states odometry and closures as edges"):
        read(CHAIN_A[:3])
    assert list(read(CHAIN_A[:1]).odometry) == ["a"]
