from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.report.html.packing import unpacked_array
from wiclosure.pipeline.report.html.radio_data import MEASUREMENTS, Tracks, alternatives, radio_pair
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import AlignmentHypothesis, AoaPath, FrameAlignment, Trajectory, WirelessLog, WirelessMeasurement

SECOND_NS = 10**9


def standing(robot: str, x_m: float, yaw_rad: float = 0.0) -> Trajectory:
    return Trajectory(
        robot, np.array([SECOND_NS, 9 * SECOND_NS]), np.stack([se3.from_yaw(yaw_rad, [x_m, 0.0, 0.0])] * 2)
    )


def alignment(paths_kept: tuple[tuple[int, int], ...] = ()) -> FrameAlignment:
    return FrameAlignment("a", "b", AlignmentHypothesis(np.eye(4), 0.0, paths_kept), None, False, "made up")


def measurement(second: float, receiver: str = "a", **more: object) -> WirelessMeasurement:
    transmitter = "b" if receiver == "a" else "a"
    return WirelessMeasurement(int(second * SECOND_NS), receiver, transmitter, range_m=4.0, range_sigma_m=0.1, **more)


def test_ranges_and_directions_of_the_estimate_from_antenna_to_antenna() -> None:
    log = WirelessLog(
        measurements=(
            measurement(2, lever_arm_receiver=(1.0, 0.0, 0.0)),
            measurement(3, receiver="b", lever_arm_transmitter=(0.0, 2.0, 0.0)),
        )
    )
    tracks = Tracks(standing("a", 0.0), standing("b", 5.0, np.pi / 2), np.array([0.0, 0.0, 7.0]))
    found = radio_pair(alignment(), log, tracks, began_ns=SECOND_NS)
    np.testing.assert_allclose(unpacked_array(found["times"]), [1.0, 2.0])
    np.testing.assert_array_equal(unpacked_array(found["a_receives"]), [1, 0])
    np.testing.assert_allclose(unpacked_array(found["estimate"]), [4.0, np.hypot(5, 2)], atol=1e-3)
    # b looks along y and has a's antenna at (-5, 2): its own axes have that at (2, 5)
    np.testing.assert_allclose(unpacked_array(found["direction"]), [0.0, np.degrees(np.arctan2(5, 2))], atol=0.01)
    np.testing.assert_allclose(unpacked_array(found["ends"])[0], [1, 0, 7, 5, 0, 7], atol=0.01)
    assert found["measured"] == 2


def test_nothing_is_estimated_before_and_after_the_paths() -> None:
    log = WirelessLog(measurements=(measurement(2), measurement(30), measurement(30, receiver="b")))
    tracks = Tracks(standing("a", 0.0), standing("b", 5.0), np.zeros(3))
    found = radio_pair(alignment(), log, tracks, began_ns=0)
    np.testing.assert_allclose(unpacked_array(found["estimate"]), [5.0, np.nan, np.nan], atol=1e-3)
    np.testing.assert_allclose(unpacked_array(found["ends"]), [[0, 0, 0, 5, 0, 0], [0] * 6, [0] * 6], atol=0.01)
    assert found["measured"] == 3


def test_the_kept_path_comes_first_and_azimuths_are_within_half_a_turn() -> None:
    paths = (AoaPath(0.1, 0.1, 0.9), AoaPath(1.5 * np.pi, 0.1, 0.1))
    log = WirelessLog(measurements=(measurement(2, paths=paths), measurement(3, paths=paths, aoa_frame="world")))
    found = radio_pair(alignment(((0, 1),)), log, Tracks(None, None, None), began_ns=0)
    azimuth, kept = unpacked_array(found["azimuth"]), unpacked_array(found["azimuth_kept"])
    np.testing.assert_allclose(azimuth[0], [-90.0, np.degrees(0.1)], atol=0.01)
    assert np.isnan(azimuth[1]).all()  # in other axes than the receiver's body
    np.testing.assert_array_equal(kept, [[1, 0], [0, 0]])
    assert np.isnan(unpacked_array(found["estimate"])).all()
    assert found["ends"] is None


def test_odds_and_distance_of_alternatives() -> None:
    best = AlignmentHypothesis(np.eye(4), -10.0, ())
    other = AlignmentHypothesis(se3.from_yaw(np.pi / 2, [3.0, 4.0, 0.0]), -10.0 - np.log(4.0), ())
    unlikely = replace(other, log_likelihood=-1e6)
    found = alternatives(FrameAlignment("a", "b", best, None, True, "", likely_alternatives=(other, unlikely)))
    assert found[0] == pytest.approx({"odds": 4.0, "apart_m": 5.0, "turned_deg": 90.0})
    assert np.isfinite(found[1]["odds"])
    assert alternatives(FrameAlignment("a", "b", None, None, True, "")) == []
    assert len(alternatives(FrameAlignment("a", "b", best, None, False, "", best_alternative=other))) == 1


def test_many_measurements_are_thinned_and_ordered() -> None:
    log = WirelessLog(measurements=tuple(measurement(1 + (7 * n % 5001) / 1000) for n in range(5001)))
    found = radio_pair(alignment(), log, Tracks(None, None, None), began_ns=0)
    times = unpacked_array(found["times"])
    assert found["measured"] == 5001
    assert MEASUREMENTS / 2 < len(times) <= MEASUREMENTS
    assert (np.diff(times) > 0).all()


def test_sigma_is_in_degrees_and_metres(lost_run: RunResult) -> None:
    certain, ambiguous = (
        radio_pair(al, lost_run.inputs.wireless, Tracks(None, None, None), began_ns=0)
        for al in lost_run.solution.filtered.alignments
    )
    assert certain["sigma"] == pytest.approx({"yaw_deg": np.degrees(0.02), "x_m": 0.3, "y_m": 0.4, "z_m": 0.5})
    assert (certain["certain"], ambiguous["certain"]) == (True, False)
    assert ambiguous["alternatives"][0]["odds"] == pytest.approx(4.0)
