"""Candidates survive a round trip, quickly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.errors import InputError, OutputError
from wiclosure.formats.candidates_csv import HEADER, read_candidates, write_candidates
from wiclosure.types import CandidatePairs, Trajectory


def trajectory(robot: str, size: int) -> Trajectory:
    poses = np.tile(np.eye(4), (size, 1, 1))
    return Trajectory(robot, 1_500_000_000_123_456_789 + np.arange(size, dtype=np.int64) * 100_000_001, poses)


def some_pairs(robot_a: str, robot_b: str, count: int, seed: int = 0) -> CandidatePairs:
    rng = np.random.default_rng(seed)
    a, b = (rng.integers(0, 40, count) for _ in range(2))
    return CandidatePairs(robot_a, robot_b, a, b, rng.uniform(0, 1, count), rng.exponential(3, count))


def test_exact_text(tmp_path: Path) -> None:
    pairs = CandidatePairs("a", "b", np.array([3]), np.array([0]), np.array([0.5]), np.array([12.0]))
    team = {
        name: Trajectory(name, np.arange(4, dtype=np.int64) * 1_500_000_000, np.tile(np.eye(4), (4, 1, 1)))
        for name in "ab"
    }
    write_candidates(tmp_path / "c.csv", [pairs], team)
    assert (tmp_path / "c.csv").read_text() == f"{HEADER}\na,3,4.500000000,b,0,0.000000000,12.000000,0.500000\n"


@settings(max_examples=40, deadline=None)
@given(name=st.text(st.characters(codec="utf-8", exclude_categories=("C",)), min_size=1, max_size=12))
def test_round_trip_with_any_name(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("csv") / "candidates.csv"
    robots = [name, 'b,"b', "c"]
    team = {robot: trajectory(robot, 40) for robot in robots}
    unknown = CandidatePairs.without_prediction('b,"b', "c", np.arange(3), np.arange(3))
    written = [some_pairs(name, 'b,"b', 20), some_pairs(name, "c", 1, 5), unknown]
    write_candidates(path, written, team)
    read = read_candidates(path)
    if name == 'b,"b':
        return
    assert [(r.pairs.robot_a, r.pairs.robot_b) for r in read] == [(w.robot_a, w.robot_b) for w in written]
    for r, w in zip(read, written, strict=True):
        np.testing.assert_array_equal(r.pairs.index_a, w.index_a)
        np.testing.assert_array_equal(r.pairs.index_b, w.index_b)
        np.testing.assert_array_equal(r.stamp_a_ns, team[w.robot_a].stamps_ns[w.index_a])
        np.testing.assert_array_equal(r.stamp_b_ns, team[w.robot_b].stamps_ns[w.index_b])
        np.testing.assert_allclose(r.pairs.mahalanobis, w.mahalanobis, atol=5.1e-7)
        np.testing.assert_allclose(r.pairs.overlap_probability, w.overlap_probability, atol=5.1e-7)


def test_no_pairs(tmp_path: Path) -> None:
    write_candidates(tmp_path / "c.csv", [some_pairs("a", "b", 0)], {r: trajectory(r, 3) for r in "ab"})
    assert read_candidates(tmp_path / "c.csv") == ()


def test_each_of_a_million_rows_is_written(tmp_path: Path) -> None:
    team = {r: trajectory(r, 40) for r in "ab"}
    write_candidates(tmp_path / "c.csv", [some_pairs("a", "b", 1_000_000)], team)
    with (tmp_path / "c.csv").open() as file:
        assert sum(1 for _ in file) == 1_000_001


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "the first line is ''"),
        ("a,b\n1,2\n", "the first line is 'a,b'"),
        (HEADER + "\nx,y\n", "not a table"),
        (HEADER + "\na,one,0.0,b,1,0.0,1,1\n", "not a table"),
        (HEADER + "\na,1,noon,b,1,0.0,1,1\n", "not a time"),
    ],
)
def test_bad_files_are_named(text: str, complaint: str, tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError, match=r"bad\.csv.*" + complaint):
        read_candidates(tmp_path / "bad.csv")


def test_unwritable_place(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot write"):
        write_candidates(tmp_path / "no" / "c.csv", [], {})
    with pytest.raises(InputError, match="cannot read"):
        read_candidates(tmp_path / "no.csv")
