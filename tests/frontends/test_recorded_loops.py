"""Place recognition and registration on recorded revisits: KITTI 05 (8.8 m apart) and 08 (reverse direction)."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import ConfigError
from wiclosure.frontends.config import RegistrationSettings, ScanContextSettings
from wiclosure.frontends.keyframes import thinned
from wiclosure.frontends.place_recognition.scan_context import ColumnSpectra, compare_descriptors, describe
from wiclosure.frontends.registration.registration import Registration
from wiclosure.types import (
    Closure,
    Float32Array,
    FloatArray,
    KeyframeId,
    Prediction,
    PredictionKind,
    Scan,
    ScanContextMatch,
    Stage,
)

LOOPS = {"05": (540, 1319), "08": (720, 1500)}
SEED = np.diag(np.square([0.03, 0.03, np.radians(10), 2.0, 2.0, 0.5]))


class Drive(Protocol):
    def __getitem__(self, index: int) -> Scan: ...


@pytest.fixture(scope="module")
def scans(data_dir: Path) -> dict[tuple[str, int], FloatArray]:
    folder = data_dir / "kitti_loop_pairs"
    if not folder.is_dir():
        pytest.skip(f"{folder} not found; set WICLOSURE_DATA")
    names = [(sequence, frame) for sequence, frames in LOOPS.items() for frame in frames]
    return {
        (sequence, frame): np.fromfile(folder / sequence / f"{frame:06d}.bin", np.float32).reshape(-1, 4)[:, :3]
        for sequence, frame in names
    }


@pytest.fixture(scope="module")
def clouds(scans: dict[tuple[str, int], FloatArray]) -> dict[tuple[str, int], Float32Array]:
    return {name: thinned(np.asarray(points, np.float64), 0.5) for name, points in scans.items()}


@pytest.fixture(scope="module")
def registration() -> Registration:
    return Registration()


def true_relative_pose(data_dir: Path, sequence: str) -> FloatArray:
    """From ground truth in the camera's frame, through the LiDAR calibration of 00 (good to a degree here)."""
    folder = data_dir / "kitti_odometry"
    calibration = next(line for line in (folder / "00_calib.txt").read_text().splitlines() if line.startswith("Tr"))
    T_camera_lidar, poses = np.eye(4), np.tile(np.eye(4), (2, 1, 1))
    T_camera_lidar[:3] = np.array(calibration.split()[1:], float).reshape(3, 4)
    poses[:, :3] = np.loadtxt(folder / "gt" / f"{sequence}.txt").reshape(-1, 3, 4)[list(LOOPS[sequence])]
    return se3.between(poses[0] @ T_camera_lidar, poses[1] @ T_camera_lidar)


def proposed(
    query: tuple[str, int],
    match: tuple[str, int],
    prediction: tuple[FloatArray, FloatArray] | None = None,
    yaw_rad: float | None = None,
) -> Closure:
    return Closure(
        KeyframeId(*query),
        KeyframeId(*match),
        prediction=None if prediction is None else Prediction(*prediction, PredictionKind.POSE),
        scan_context=None if yaw_rad is None else ScanContextMatch(0.2, yaw_rad),
    )


def measured_pose(closure: Closure) -> FloatArray:
    assert closure.measured is not None, closure.reason
    return closure.measured.T_query_match


def test_scan_context_recognises_the_reverse_loop_among_unrelated_scans(
    scans: dict[tuple[str, int], FloatArray],
) -> None:
    names = list(scans)
    spectra = ColumnSpectra.of(np.stack([describe(scans[name], ScanContextSettings()) for name in names]))
    query, match = names.index(("08", 720)), names.index(("08", 1500))
    distance, yaw = compare_descriptors(spectra, spectra, np.array([query]), np.array([match]))
    assert distance[0] == pytest.approx(0.22, abs=0.03)
    assert np.degrees(yaw[0]) % 360 == pytest.approx(210, abs=6)
    unrelated = np.array([[query, 0], [query, 1], [match, 0], [match, 1]])
    assert compare_descriptors(spectra, spectra, *unrelated.T)[0].min() > 0.45


@pytest.mark.parametrize("sequence", sorted(LOOPS))
def test_loops_are_registered_from_a_seed_two_metres_and_ten_degrees_off(
    sequence: str, data_dir: Path, clouds: dict[tuple[str, int], Float32Array], registration: Registration
) -> None:
    query, match = ((sequence, frame) for frame in LOOPS[sequence])
    truth = true_relative_pose(data_dir, sequence)
    tight = np.diag(np.square([0.03, 0.03, 0.03, 1.5, 1.5, 0.5]))
    reference = registration.verify(proposed(query, match, (truth, tight)), clouds[query], clouds[match])
    gap = se3.between(truth, measured_pose(reference))
    assert np.linalg.norm(gap[:3, 3]) < 1.5  # ground truth of 08 is 1.2 m off here
    assert np.degrees(se3.rotation_angle(gap)) < 1.0
    for direction in np.arange(0, 2 * np.pi, np.pi / 2):
        off = se3.from_yaw(np.radians(10), 2.0 * np.array([np.cos(direction), np.sin(direction), 0.0]))
        seed = (measured_pose(reference) @ off, SEED)
        found = registration.verify(proposed(query, match, seed), clouds[query], clouds[match])
        assert found.live, found.reason
        gap = se3.between(measured_pose(reference), measured_pose(found))
        assert np.linalg.norm(gap[:3, 3]) < 0.3
        assert np.degrees(se3.rotation_angle(gap)) < 1.0


@pytest.mark.parametrize("predicted", [False, True])
def test_scans_of_different_places_are_refused(
    predicted: bool, clouds: dict[tuple[str, int], Float32Array], registration: Registration
) -> None:
    for query, match in ((("05", 540), ("08", 720)), (("08", 1500), ("05", 1319))):
        prediction = (np.eye(4), SEED) if predicted else None
        refused = registration.verify(proposed(query, match, prediction, 0.3), clouds[query], clouds[match])
        assert refused.rejected_at is Stage.REGISTRATION
        assert "structure matches" in refused.reason


@pytest.mark.parametrize("start", ["scan-context", "kiss-matcher"])
def test_loops_are_found_without_any_prediction(
    start: Literal["scan-context", "kiss-matcher"], data_dir: Path, clouds: dict[tuple[str, int], Float32Array]
) -> None:
    if start == "kiss-matcher":
        pytest.importorskip("kiss_matcher", reason="an optional library without wheels for this Python")
    registration = Registration(RegistrationSettings(global_start=start))
    for sequence, frames in LOOPS.items():
        query, match = ((sequence, frame) for frame in frames)
        found = registration.verify(proposed(query, match), clouds[query], clouds[match])
        assert found.live, found.reason
        gap = se3.between(true_relative_pose(data_dir, sequence), measured_pose(found))
        assert np.linalg.norm(gap[:3, 3]) < 1.5
        assert np.degrees(se3.rotation_angle(gap)) < 1.5
        again = registration.verify(proposed(query, match), clouds[query], clouds[match])
        # KISS-Matcher's threads add up in another order each time.
        tolerance = 0.0 if start == "scan-context" else 0.02
        np.testing.assert_allclose(measured_pose(again), measured_pose(found), rtol=0, atol=tolerance)
    unrelated = registration.verify(proposed(("05", 540), ("08", 720)), clouds["05", 540], clouds["08", 720])
    assert unrelated.rejected_at is Stage.REGISTRATION


def test_kiss_matcher_missing_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "kiss_matcher", None)
    with pytest.raises(ConfigError, match=r"not installed; pip install 'wiclosure\[kiss-matcher\]'"):
        Registration(RegistrationSettings(global_start="kiss-matcher"))


def test_two_ends_of_one_street_are_refused(kitti_drive: Drive, registration: Registration) -> None:
    query, match = (thinned(kitti_drive[index].points, 0.5) for index in (0, 150))
    refused = registration.verify(proposed(("drive", 0), ("drive", 150)), query, match)
    assert refused.rejected_at is Stage.REGISTRATION
