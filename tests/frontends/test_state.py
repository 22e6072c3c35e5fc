from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.formats.unpacking import read_arrays
from wiclosure.frontends.config import KeyframeSettings, OdometrySettings
from wiclosure.frontends.front_end import OdometryRun
from wiclosure.frontends.state import packed, part, under, unpacked, unpacked_all
from wiclosure.types import Scan, Trajectory

PERIOD_NS = 10**8


def walls(seed: int, count: int = 1500) -> np.ndarray:
    points = np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * [10, 8, 3]
    points[: count // 2, 0] = np.sign(points[: count // 2, 0]) * 10
    points[count // 2 :, 1] = np.sign(points[count // 2 :, 1]) * 8
    return points


def scans(intensity: bool, count: int = 8) -> list[Scan]:
    here = [se3.transform(se3.exp(np.array([0, 0, -0.02 * k, -0.3 * k, 0, 0])), walls(0)) for k in range(count)]
    seen = np.linspace(0, 255, len(here[0])).astype(np.float32) if intensity else None
    return [Scan(k * PERIOD_NS, points, intensity=seen) for k, points in enumerate(here)]


def recorded() -> Trajectory:
    poses = se3.exp(np.array([[0, 0, 0.02 * k, 0.3 * k, 0, 0] for k in range(10)]))
    return Trajectory("alpha", np.arange(10) * PERIOD_NS, poses)


@pytest.mark.parametrize("intensity", [False, True])
@pytest.mark.parametrize("several", [1, 3])
@pytest.mark.parametrize("trajectory", [lambda: None, recorded], ids=["kiss-icp", "recorded"])
@pytest.mark.parametrize("before", [0, 1, 4])
def test_a_run_goes_on_from_a_file_of_its_state(
    tmp_path: Path, intensity: bool, several: int, trajectory: Callable[[], Trajectory | None], before: int
) -> None:
    keyframes = [KeyframeSettings(distance_m=0.5, scans=several), KeyframeSettings(distance_m=0.2)]

    def begun() -> OdometryRun:
        return OdometryRun(OdometrySettings(), keyframes, "alpha", trajectory())

    all_scans, whole, first, second = scans(intensity), begun(), begun(), begun()
    whole.process_all(all_scans)
    first.process_all(all_scans[:before])
    with (tmp_path / "state").open("wb") as file:
        np.savez(file, allow_pickle=False, **first.state())
    second.restore(read_arrays(tmp_path / "state"))
    assert second.scans == before
    second.process_all(all_scans[before:])
    for one, other in zip(whole.results(), second.results(), strict=True):
        assert one.poses.tobytes() == other.poses.tobytes()
        assert one.stamps_ns.tolist() == other.stamps_ns.tolist()
        assert one.keyframe_indices.tolist() == other.keyframe_indices.tolist()
        assert [cloud.tobytes() for cloud in one.clouds] == [cloud.tobytes() for cloud in other.clouds]
        assert one.counts == other.counts
        assert (one.intensities is None) == (not intensity)
        assert [of.tobytes() for of in one.intensities or ()] == [of.tobytes() for of in other.intensities or ()]


@given(st.lists(st.one_of(st.none(), st.integers(0, 5))))
def test_arrays_of_any_lengths_come_back(lengths: list[int | None]) -> None:
    arrays = [None if n is None else np.full((n, 3), k, np.float32) for k, n in enumerate(lengths)]
    back = unpacked(part("x", under("x", packed(arrays))))
    assert [None if a is None else len(a) for a in back] == lengths
    assert all(a is None or b is None or a.tobytes() == b.tobytes() for a, b in zip(arrays, back, strict=True))
    assert len(unpacked_all(packed(arrays))) == len(lengths) - lengths.count(None)


def test_rows_that_are_not_there_are_refused() -> None:
    with pytest.raises(ValueError, match="4 rows announced, 3 there"):
        unpacked({"lengths": np.array([2, 2]), "rows": np.zeros(3)})
