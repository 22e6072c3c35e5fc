from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.stages.closures_csv import CLOSURE_COLUMNS, decision, write_closures
from wiclosure.types import (
    Closure,
    KeyframeId,
    Measured,
    RegistrationEvidence,
    Residual,
    ScanContextMatch,
    Stage,
    Trajectory,
)

SECOND = 1_000_000_000
KEYFRAMES = {
    robot: Trajectory(robot, np.arange(3) * SECOND + SECOND // 2, np.tile(np.eye(4), (3, 1, 1)))
    for robot in ("alpha", "beta")
}
ENDS = KeyframeId("alpha", 0), KeyframeId("beta", 2)
PROPOSED = Closure(*ENDS, scan_context=ScanContextMatch(0.25, np.pi / 2), overlap_probability=0.75)
MEASURED = PROPOSED.measured_as(
    Measured(
        se3.from_yaw(0.0, np.array([1.0, 2.0, 3.0])),
        np.eye(6),
        RegistrationEvidence(inliers=120, inlier_ratio=0.5, agreement=0.97, rms_m=0.125, prediction_chi2=2.5),
    )
)


def rows(path: Path, *closures: Closure) -> list[dict[str, str]]:
    write_closures(path / "closures.csv", closures, KEYFRAMES)
    with (path / "closures.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_closure_in_the_map_has_all_that_is_known_of_it(tmp_path: Path) -> None:
    done = MEASURED.accepted(Stage.REGISTRATION, "it fits").accepted(Stage.ESTIMATE, "one of 4 closures that agree")
    done = replace(done, consistent_with=3, residual=Residual(0.5, 0.0625))
    (row,) = rows(tmp_path, done)
    assert row == {
        "query_robot": "alpha", "query_index": "0", "query_stamp": "0.500000000",
        "match_robot": "beta", "match_index": "2", "match_stamp": "2.500000000",
        "decision": "accepted", "reason": "one of 4 closures that agree",
        "x": "1.000000", "y": "2.000000", "z": "3.000000",
        "qx": "0.000000", "qy": "0.000000", "qz": "0.000000", "qw": "1.000000",
        "scan_context_distance": "0.25", "scan_context_yaw": "1.5708", "overlap_probability": "0.75",
        "prior_chi2": "2.5", "inliers": "120", "inlier_ratio": "0.5", "agreement": "0.97", "rms_m": "0.125",
        "consistent_with": "3", "residual_m": "0.5", "residual_rad": "0.0625",
    }  # fmt: skip
    assert tuple(row) == CLOSURE_COLUMNS


def test_poses_are_written_between_the_bodies_at_the_stamps(tmp_path: Path) -> None:
    """Clouds belong to the ends of sweeps, here one metre further along x for both robots."""
    clouds = {
        robot: Trajectory(
            robot, frames.stamps_ns + SECOND // 10, frames.poses @ se3.from_yaw(0.0, np.array([1.0, 0, 0]))
        )
        for robot, frames in KEYFRAMES.items()
    }
    T_query_match = se3.from_yaw(np.pi, np.array([5.0, 0, 0]))  # they face each other, 5 m apart
    write_closures(
        tmp_path / "closures.csv", [Closure.from_measurement(*ENDS, T_query_match, np.eye(6))], KEYFRAMES, clouds
    )
    with (tmp_path / "closures.csv").open(newline="", encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert (row["query_stamp"], row["match_stamp"]) == ("0.500000000", "2.500000000")
    assert float(row["x"]) == pytest.approx(7.0)


def test_what_is_unknown_is_empty(tmp_path: Path) -> None:
    guessed, bare = rows(
        tmp_path,
        PROPOSED.rejected(Stage.REGISTRATION, "only 3 points of one cloud stand on the ground"),
        Closure.from_measurement(*ENDS, np.eye(4), np.eye(6)),
    )
    unknown = ("prior_chi2", "inlier_ratio", "agreement", "rms_m", "residual_m", "residual_rad")
    assert {guessed[name] for name in unknown} == {bare[name] for name in unknown} == {""}
    assert (guessed["inliers"], guessed["consistent_with"]) == ("0", "0")
    assert (guessed["x"], guessed["qz"], guessed["scan_context_distance"]) == ("0.000000", "0.707107", "0.25")
    assert (bare["scan_context_distance"], bare["scan_context_yaw"], bare["overlap_probability"]) == ("", "", "")


@pytest.mark.parametrize(
    ("closure", "word"),
    [
        (PROPOSED, "proposed"),
        (MEASURED, "proposed"),
        (MEASURED.accepted(Stage.REGISTRATION), "verified"),
        (MEASURED.accepted(Stage.RADIO_CHECK), "verified"),
        (MEASURED.accepted(Stage.CONSISTENCY), "accepted"),
        (MEASURED.accepted(Stage.ESTIMATE), "accepted"),
        (MEASURED.accepted(Stage.CONSISTENCY).rejected(Stage.ESTIMATE, "no"), "rejected"),
    ],
)
def test_files_have_one_word_for_how_far_a_closure_came(closure: Closure, word: str) -> None:
    assert decision(closure) == word
