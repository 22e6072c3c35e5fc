"""WSR-Toolbox output: real result files, peak picking in profile matrices, bad input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wiclosure.errors import InputError
from wiclosure.formats.radio.wsr import AoaNoise, read_wsr_matrix, read_wsr_profiles, wsr_wireless_log


def record(**changes: object) -> dict[str, object]:
    peak = {"estimated_azimuth": -90.0, "estimated_elevation": 60.0}
    return {
        "a_INFO_Transmitting_robot": {"Name": "tx2", "groundtruth_azimuth": -80.0},
        "b_INFO_Receiving_robot": {"id": 9, "displacement_type": "3D"},
        "d_INFO_AOA_profile": {"Profile_variance": 0.7, "Top_N_peaks": {"1": peak}},
    } | changes


def test_real_results_are_bearings_near_the_truth(data_dir: Path) -> None:
    profiles = read_wsr_profiles(data_dir / "wifi_aoa" / "LOS_Set_A_using_groundtruth_displacement.json")
    assert len(profiles) == 150
    error = np.array([np.angle(np.exp(1j * (p.azimuth[0] - p.true_azimuth))) for p in profiles])
    assert np.degrees(np.median(np.abs(error))) < 5
    assert all(p.elevation is None for p in profiles)  # planar displacement tells no elevation


def test_polar_elevation_becomes_elevation_above_the_horizon(tmp_path: Path) -> None:
    file = tmp_path / "wsr.json"
    file.write_text(json.dumps({"4": [record()]}))
    (profile,) = read_wsr_profiles(file)
    assert profile.elevation is not None
    np.testing.assert_allclose(np.degrees([profile.azimuth[0], profile.elevation[0]]), [-90, 30])
    log = wsr_wireless_log([profile], {"4": 7_000_000_000}, {"9": "alpha", "tx2": "beta"})
    (measurement,) = log.measurements
    assert (measurement.receiver, measurement.transmitter, measurement.aoa_frame) == ("alpha", "beta", "odometry")
    assert measurement.stamp_ns == 7_000_000_000
    assert measurement.paths[0].sigma == pytest.approx(AoaNoise().sigma_rad(0.7))


def test_trials_without_a_stamp_are_named(tmp_path: Path) -> None:
    file = tmp_path / "wsr.json"
    file.write_text(json.dumps({"4": [record()]}))
    with pytest.raises(InputError, match="'4'"):
        wsr_wireless_log(read_wsr_profiles(file), {})


@pytest.mark.parametrize(
    "content",
    [
        "{",
        "[]",
        '{"1": 3}',
        '{"1": [{}]}',
        json.dumps({"1": [record(d_INFO_AOA_profile={"Profile_variance": "x", "Top_N_peaks": {}})]}),
        json.dumps({"1": [record(d_INFO_AOA_profile={"Profile_variance": float("nan"), "Top_N_peaks": {}})]}),
        json.dumps({"1": [record(d_INFO_AOA_profile={"Profile_variance": 1, "Top_N_peaks": {"x": {}}})]}),
    ],
)
def test_what_is_not_a_result_is_refused_by_name(tmp_path: Path, content: str) -> None:
    file = tmp_path / "bad.json"
    file.write_text(content)
    with pytest.raises(InputError, match=r"bad\.json"):
        read_wsr_profiles(file)


def profile_matrix(peaks: list[tuple[float, float, float]], sigma_deg: float = 8.0) -> np.ndarray:
    """Sum of bumps `(azimuth, polar elevation, height)`, degrees."""
    azimuth = np.arange(-180, 180)[:, None]
    polar = np.linspace(0, 180, 180)[None, :]
    total = np.full((360, 180), 1e-6)
    for at, up, height in peaks:
        away = (azimuth - at + 180) % 360 - 180
        total += height * np.exp(-(away**2 + (polar - up) ** 2) / (2 * sigma_deg**2))
    return total


def test_peaks_of_a_matrix_are_found_strongest_first_with_their_width(tmp_path: Path) -> None:
    file = tmp_path / "profile.csv"
    np.savetxt(file, profile_matrix([(-178, 90, 1.0), (40, 60, 0.5), (46, 62, 0.3), (120, 90, 0.1)]), delimiter=",")
    first, second = read_wsr_matrix(file)
    assert np.degrees(first.azimuth) == pytest.approx(-178, abs=1)
    assert np.degrees(first.sigma) == pytest.approx(8, abs=1.5)
    assert first.elevation == pytest.approx(0, abs=0.02)
    assert np.degrees(second.azimuth) == pytest.approx(42.5, abs=3)
    assert second.elevation == pytest.approx(np.radians(29.2), abs=0.04)


@pytest.mark.parametrize("content", ["", "1,2\n3", "a,b\n", "nan,1\n" * 9, "-1,1\n" * 9, "0,0\n" * 9, "1,2\n1,2\n"])
def test_what_is_not_a_profile_matrix_is_refused_by_name(tmp_path: Path, content: str) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(content)
    with pytest.raises(InputError, match=r"bad\.csv"):
        read_wsr_matrix(file)
    with pytest.raises(InputError, match="nowhere"):
        read_wsr_matrix(tmp_path / "nowhere.csv")


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=80))
def test_any_bytes_are_read_or_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "fuzz"
    file.write_bytes(content)
    for read in (read_wsr_profiles, read_wsr_matrix):
        try:
            assert isinstance(read(file), tuple)
        except InputError as error:
            message = str(error)
            assert str(file) in message
