"""What the front end hands on, and how it is kept on disk between runs."""

from __future__ import annotations

import zipfile
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Self

import numpy as np

from wiclosure.drift import DriftModel
from wiclosure.errors import InputError
from wiclosure.types import Float32Array, IntArray, Trajectory


@dataclass(frozen=True, slots=True)
class FrontEndCounts:
    """How many scans came in, and how many were left out.

    Args:
        scans: all that came.
        sparse: left out, as too few of their points lay within range.
        late: left out, as their stamp did not follow the one before.
    """

    scans: int
    sparse: int = 0
    late: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class FrontEndResult:
    """One robot's odometry and keyframes.

    Args:
        robot: its name.
        odometry: pose of every usable scan.
        keyframe_indices: `(K,)` which of them are keyframes.
        keyframes: their poses; keyframe k of this robot is pose k here.
        clouds: K clouds `(N_k, 3)` float32, deskewed and thinned, in the body's axes.
        descriptors: `(K, rings, sectors)` float32 scan contexts.
        counts: scans in, scans left out.
        seconds_odometry: wall time of the odometry.
        seconds_descriptors: wall time of thinning clouds and describing them.
    """

    robot: str
    odometry: Trajectory
    keyframe_indices: IntArray
    keyframes: Trajectory
    clouds: tuple[Float32Array, ...]
    descriptors: Float32Array
    counts: FrontEndCounts
    seconds_odometry: float
    seconds_descriptors: float

    def save(self, path: Path) -> None:
        """Writes one `.npz` file: all clouds in one array, with offsets."""
        sizes = [len(cloud) for cloud in self.clouds]
        with path.open("wb") as file:
            np.savez(
                file,
                robot=np.array(self.robot),
                stamps_ns=self.odometry.stamps_ns,
                poses=self.odometry.poses,
                drift=np.array(self.odometry.drift.model_dump_json()),
                keyframe_indices=self.keyframe_indices,
                points=np.concatenate(self.clouds),
                offsets=np.cumsum([0, *sizes]),
                descriptors=self.descriptors,
                counts=np.array(astuple(self.counts)),
                seconds=np.array([self.seconds_odometry, self.seconds_descriptors]),
            )

    @classmethod
    def load(cls, path: Path) -> Self:
        """Reads what `save` wrote.

        Raises:
            InputError: the file is missing, damaged or of something else.
        """
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as pack:
                content = {name: pack[name] for name in pack.files}
            odometry = Trajectory(
                str(content["robot"]),
                content["stamps_ns"],
                content["poses"],
                DriftModel.model_validate_json(str(content["drift"])),
            )
            indices, offsets = content["keyframe_indices"], content["offsets"]
            return cls(
                robot=odometry.robot,
                odometry=odometry,
                keyframe_indices=indices,
                keyframes=odometry.keyframes(indices),
                clouds=tuple(np.split(content["points"], offsets[1:-1])),
                descriptors=content["descriptors"],
                counts=FrontEndCounts(*content["counts"].tolist()),
                seconds_odometry=float(content["seconds"][0]),
                seconds_descriptors=float(content["seconds"][1]),
            )
        except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
            raise InputError(
                f"{path} is not a saved front end result ({error}); delete it to have it made anew"
            ) from error
