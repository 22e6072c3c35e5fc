from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.errors import InputError
from wiclosure.frontends.front_end_result import Descriptors, FrontEndCounts, FrontEndResult, OdometryResult

SPEED = np.array([0.0, 0.0, 0.2, 2.0, 0.0, 0.0])  # a second


def followed(sizes: list[int], seed: int = 0, sweep_ns: int = 100_000_000) -> OdometryResult:
    """An even drive of which every second scan is a keyframe; clouds of the given sizes."""
    n, rng = 2 * len(sizes), np.random.default_rng(seed)
    stamps_ns = 10**12 + np.arange(n) * 10**9
    return OdometryResult(
        stamps_ns=stamps_ns,
        scan_stamps_ns=stamps_ns - sweep_ns,
        poses=se3.exp(np.arange(n)[:, None] * SPEED),
        keyframe_indices=np.arange(0, n, 2),
        clouds=tuple(rng.normal(size=(size, 3)).astype(np.float32) for size in sizes),
        counts=FrontEndCounts(n + 6, sparse=1, late=2, outside=3),
        seconds=1.25,
        seconds_reading=0.5,
    )


@given(sizes=st.lists(st.integers(0, 30), min_size=1, max_size=6), seed=st.integers(0, 99))
def test_what_is_saved_is_read_back_bit_for_bit(tmp_path_factory, sizes, seed):
    path = tmp_path_factory.mktemp("saved") / "odometry"
    saved = followed(sizes, seed)
    saved.save(path)
    loaded = OdometryResult.load(path)
    assert (loaded.counts, loaded.seconds, loaded.seconds_reading) == (saved.counts, 1.25, 0.5)
    for name in ("stamps_ns", "scan_stamps_ns", "poses", "keyframe_indices"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(saved, name))
    assert [cloud.tolist() for cloud in loaded.clouds] == [cloud.tolist() for cloud in saved.clouds]
    assert all(cloud.dtype == np.float32 for cloud in loaded.clouds)


def test_descriptors_are_read_back(tmp_path: Path) -> None:
    images = np.random.default_rng(0).random((3, 20, 60), np.float32)
    Descriptors(images, 0.75).save(tmp_path / "descriptors")
    loaded = Descriptors.load(tmp_path / "descriptors")
    np.testing.assert_array_equal(loaded.images, images)
    assert loaded.seconds == 0.75
    assert repr(loaded) == "Descriptors(3 keyframes, 20 rings, 60 sectors)"


@pytest.mark.parametrize("at", [0.0, 0.02, 0.3, 0.6, 0.97])
def test_cut_and_flipped_files_are_one_clear_error(tmp_path: Path, at: float) -> None:
    path = tmp_path / "alpha.cache"
    followed([40, 40]).save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(at * len(whole))])
    with pytest.raises(InputError, match=r"alpha\.cache is not a saved odometry .* delete it to have it made anew"):
        OdometryResult.load(path)


def test_another_stages_file_and_a_missing_one_are_named(tmp_path: Path) -> None:
    Descriptors(np.zeros((1, 2, 4), np.float32), 0.0).save(tmp_path / "descriptors")
    with pytest.raises(InputError, match="descriptors is not a saved odometry"):
        OdometryResult.load(tmp_path / "descriptors")
    with pytest.raises(InputError, match=r"missing holds no saved descriptors \(.*No such file"):
        Descriptors.load(tmp_path / "missing")


def test_scans_have_poses_at_their_own_stamps_and_keyframes_at_the_last_point() -> None:
    drift = DriftModel(translation_walk=0.07)
    stages = followed([5, 5, 5])
    result = FrontEndResult.of("alpha", drift, stages, Descriptors(np.zeros((3, 20, 60), np.float32), 0.25))
    np.testing.assert_array_equal(result.keyframes.poses, result.odometry.poses[::2])
    np.testing.assert_allclose(
        result.scans.poses, se3.exp((np.arange(6) - 0.1)[:, None] * SPEED), atol=0.02
    )  # chords of an arc; the motion goes on evenly before the first pose
    assert result.odometry.drift is result.keyframes.drift is result.scans.drift is drift
    assert (result.seconds_odometry, result.seconds_reading, result.seconds_descriptors) == (1.25, 0.5, 0.25)
    assert result.counts == stages.counts
    assert repr(result) == "FrontEndResult('alpha', 6 scans, 3 keyframes, 10.0 m)"
    assert {field.name for field in fields(FrontEndCounts)} == {"scans", "sparse", "late", "outside"}


def test_another_path_takes_slips_along_but_those_it_mended():
    n = 60
    poses = se3.exp(np.arange(n)[:, None] * 0.1 * SPEED)
    poses[30:] = poses[30:] @ se3.from_yaw(0.0, np.array([0.0, 9.0, 0.0]))
    stamps_ns = 10**12 + np.arange(n) * 10**8
    result = FrontEndResult.of(
        "alpha",
        DriftModel(),
        OdometryResult(stamps_ns, stamps_ns - 10**7, poses, np.arange(0, n, 2),
                       tuple(np.zeros((1, 3), np.float32) for _ in range(n // 2)), FrontEndCounts(n), 0.0, 0.0,
                       lost=np.array([50])),
        Descriptors(np.zeros((n // 2, 2, 2), np.float32), 0.0),
    )  # fmt: skip
    assert {30, 50} <= set(result.slips.index[result.slips.gross].tolist())
    straight = replace(result.odometry, poses=se3.exp(np.arange(n)[:, None] * 0.1 * SPEED))
    mended = result.replaced(straight, np.isin(np.arange(1, n), np.arange(25, 36)))
    assert mended.slips.index.tolist() == [50]
    np.testing.assert_array_equal(mended.keyframes.poses, straight.poses[::2])
    np.testing.assert_allclose(
        mended.scans.poses[5:], straight.at(stamps_ns - 10**7 * (np.arange(n) >= 0))[5:], atol=1e-9
    )
