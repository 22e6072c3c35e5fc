"""What the front end hands on, and how it is kept on disk between runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from wiclosure.drift import DriftModel
from wiclosure.errors import InputError
from wiclosure.formats.unpacking import read_arrays
from wiclosure.frontends.inertial.slips import Slips, find_slips, lost_steps, opened
from wiclosure.types import BoolArray, Float32Array, FloatArray, IntArray, Trajectory


@dataclass(frozen=True, slots=True)
class FrontEndCounts:
    """How many scans came in, and how many were left out.

    Args:
        scans: all that came.
        sparse: left out, as too few of their points lay within range.
        late: left out, as their stamp did not follow the one before.
        outside: left out, as the recorded odometry does not reach to them.
    """

    scans: int
    sparse: int = 0
    late: int = 0
    outside: int = 0


def _no_scans() -> IntArray:
    return np.zeros(0, np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class OdometryResult:
    """The path of one robot, and the clouds of its keyframes.

    Args:
        stamps_ns: `(N,)` when the last point of every usable scan was measured.
        scan_stamps_ns: `(N,)` these scans' own stamps.
        poses: `(N, 4, 4)` `T_odom_body` at `stamps_ns`.
        keyframe_indices: `(K,)` which of them are keyframes.
        clouds: K clouds `(N_k, 3)` float32, deskewed and thinned, in the body's axes.
        counts: scans in, scans left out.
        seconds: wall time of following the scans.
        seconds_reading: wall time of waiting for them.
        intensities: K arrays `(N_k,)` of the clouds' points, in the sensor's own unit; None where it tells none.
        found_again: indices of scans that did not fit where odometry put them first, and fit where it found them again.
        lost: indices of scans that fit nowhere.
    """

    stamps_ns: IntArray
    scan_stamps_ns: IntArray
    poses: FloatArray
    keyframe_indices: IntArray
    clouds: tuple[Float32Array, ...]
    counts: FrontEndCounts
    seconds: float
    seconds_reading: float
    intensities: tuple[NDArray[np.float16], ...] | None = None
    found_again: IntArray = field(default_factory=_no_scans)
    lost: IntArray = field(default_factory=_no_scans)

    def __repr__(self) -> str:
        return f"OdometryResult({len(self.poses)} of {self.counts.scans} scans followed, {len(self.clouds)} keyframes)"

    def save(self, path: Path) -> None:
        """Writes one `.npz` file: all clouds in one array, with offsets."""
        known = {} if self.intensities is None else {"intensities": np.concatenate(self.intensities)}
        _save(
            path,
            stamps_ns=self.stamps_ns,
            scan_stamps_ns=self.scan_stamps_ns,
            poses=self.poses,
            keyframe_indices=self.keyframe_indices,
            points=np.concatenate(self.clouds),
            offsets=np.cumsum([0, *(len(cloud) for cloud in self.clouds)]),
            counts=np.array(astuple(self.counts)),
            seconds=np.array(self.seconds),
            seconds_reading=np.array(self.seconds_reading),
            **known,
            found_again=self.found_again,
            lost=self.lost,
        )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            InputError: the file is missing, damaged or of something else.
        """
        with _content(path, "is not a saved odometry") as content:
            inner, intensities = content["offsets"][1:-1], content.get("intensities")
            return cls(
                stamps_ns=content["stamps_ns"],
                scan_stamps_ns=content["scan_stamps_ns"],
                poses=content["poses"],
                keyframe_indices=content["keyframe_indices"],
                clouds=tuple(np.split(content["points"], inner)),
                counts=FrontEndCounts(*content["counts"].tolist()),
                seconds=float(content["seconds"]),
                seconds_reading=float(content["seconds_reading"]),
                intensities=None if intensities is None else tuple(np.split(intensities, inner)),
                found_again=content["found_again"],
                lost=content["lost"],
            )


@dataclass(frozen=True, slots=True, eq=False)
class Descriptors:
    """Scan contexts of one robot's keyframes.

    Args:
        images: `(K, rings, sectors)` float32.
        seconds: wall time of describing them.
    """

    images: Float32Array
    seconds: float

    def __repr__(self) -> str:
        keyframes, rings, sectors = self.images.shape
        return f"Descriptors({keyframes} keyframes, {rings} rings, {sectors} sectors)"

    def save(self, path: Path) -> None:
        """Writes one `.npz` file."""
        _save(path, images=self.images, seconds=np.array(self.seconds))

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            InputError: the file is missing, damaged or of something else.
        """
        with _content(path, "holds no saved descriptors") as content:
            return cls(content["images"], float(content["seconds"]))


@dataclass(frozen=True, slots=True, eq=False)
class FrontEndResult:
    """One robot's odometry and keyframes.

    Args:
        robot: its name.
        odometry: pose of every usable scan when its last point was measured.
        scans: pose of every usable scan at its own stamp: what files and users know a scan by.
        keyframe_indices: `(K,)` which of them are keyframes.
        keyframes: their poses; keyframe k of this robot is pose k here.
        clouds: K clouds `(N_k, 3)` float32, deskewed and thinned, in the body's axes.
        descriptors: `(K, rings, sectors)` float32 scan contexts.
        counts: scans in, scans left out.
        seconds_reading: wall time of waiting for the scans.
        seconds_odometry: wall time of odometry and clouds.
        seconds_descriptors: wall time of describing them.
        slips: steps of the odometry that count as unknown by how far they are off.
        intensities: K arrays `(N_k,)` of the clouds' points, in the sensor's own unit; None where it tells none.
        found_again_ns: stamps of scans that odometry had lost for a moment.
    """

    robot: str
    odometry: Trajectory
    scans: Trajectory
    keyframe_indices: IntArray
    keyframes: Trajectory
    clouds: tuple[Float32Array, ...]
    descriptors: Float32Array
    counts: FrontEndCounts
    seconds_reading: float
    seconds_odometry: float
    seconds_descriptors: float
    slips: Slips = field(default_factory=Slips.none)
    intensities: tuple[NDArray[np.float16], ...] | None = None
    found_again_ns: IntArray = field(default_factory=_no_scans)

    def __repr__(self) -> str:
        scans, length_m = len(self.odometry), self.odometry.distance[-1]
        return f"FrontEndResult({self.robot!r}, {scans} scans, {len(self.keyframes)} keyframes, {length_m:.1f} m)"

    @classmethod
    def of(cls, robot: str, drift: DriftModel, followed: OdometryResult, described: Descriptors) -> Self:
        """Puts together what the stages found."""
        plain = Trajectory(robot, followed.stamps_ns, followed.poses, drift)
        slips = find_slips(plain) + lost_steps(plain, followed.lost)
        odometry = opened(plain, slips)
        return cls(
            robot=robot,
            odometry=odometry,
            scans=Trajectory(robot, followed.scan_stamps_ns, odometry.at_or_beyond(followed.scan_stamps_ns), drift),
            keyframe_indices=followed.keyframe_indices,
            keyframes=odometry.keyframes(followed.keyframe_indices),
            clouds=followed.clouds,
            descriptors=described.images,
            counts=followed.counts,
            seconds_reading=followed.seconds_reading,
            seconds_odometry=followed.seconds,
            seconds_descriptors=described.seconds,
            slips=slips,
            intensities=followed.intensities,
            found_again_ns=followed.stamps_ns[followed.found_again],
        )

    def slipping(self, more: Slips) -> Self:
        """With more steps that are not to be trusted."""
        slips = self.slips + more
        odometry = opened(replace(self.odometry, step_covariances=None), slips)
        return replace(self, odometry=odometry, keyframes=odometry.keyframes(self.keyframe_indices), slips=slips)

    def replaced(self, odometry: Trajectory, steps: BoolArray) -> Self:
        """With another path, whose `steps (N - 1,)` are no longer this odometry's, nor its slips."""
        kept = np.flatnonzero(self.slips.gross & ~steps[self.slips.index - 1])
        slips = find_slips(replace(odometry, step_covariances=None)) + self.slips.subset(kept)
        odometry = opened(replace(odometry, step_covariances=None), slips)
        return replace(
            self,
            odometry=odometry,
            scans=replace(self.scans, poses=odometry.at_or_beyond(self.scans.stamps_ns)),
            keyframes=odometry.keyframes(self.keyframe_indices),
            slips=slips,
        )

    def moved(self, T_new_odom: FloatArray) -> Self:
        """The same in another frame of the odometry; clouds are in the body's axes and stay."""
        return replace(
            self,
            odometry=self.odometry.moved(T_new_odom),
            scans=self.scans.moved(T_new_odom),
            keyframes=self.keyframes.moved(T_new_odom),
        )


def _save(path: Path, **arrays: Any) -> None:
    with path.open("wb") as file:
        np.savez(file, **arrays)


@contextmanager
def _content(path: Path, complaint: str) -> Iterator[dict[str, Any]]:
    """All arrays of a saved stage; every member carries a checksum, which reading it verifies.

    Raises:
        InputError: it cannot be read, or what is done with it fails; the sentence holds the complaint.
    """
    try:
        yield read_arrays(path)
    except (InputError, KeyError, ValueError, TypeError, IndexError, ArithmeticError) as error:
        raise InputError(f"{path} {complaint} ({error}); delete it to have it made anew") from error
