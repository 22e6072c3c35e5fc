"""A constant error of odometry, as of a gyroscope's bias or a wheel's radius: what it is, and odometry without it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, Trajectory

MOST_OF_MOTION = 0.5  # that an error may make of it: with more, odometry would tell less of motion than closures deny


@dataclass(frozen=True, slots=True, eq=False)
class SteadyError:
    """What a robot's odometry errs by, metre after metre.

    Args:
        robot: its name.
        per_m: `(6,)` tangent vector, rad and m per metre of its path, from what odometry says of a step to what
            closures do.
    """

    robot: str
    per_m: FloatArray

    def corrected(self, trajectory: Trajectory) -> Trajectory:
        """The trajectory from the same first pose without the error; covariances stay."""
        steps = se3.between(trajectory.poses[:-1], trajectory.poses[1:])
        moved = se3.exp(np.diff(trajectory.distance)[:, None] * self.per_m)
        poses = chained(np.concatenate([trajectory.poses[:1], steps @ moved]))
        return replace(trajectory, poses=poses, finer=_moved_along(trajectory, poses))

    @property
    def plausible(self) -> bool:
        """Whether it leaves odometry more of each metre than it takes: closures of places alike say a robot stood."""
        return bool(np.linalg.norm(self.per_m[3:]) <= MOST_OF_MOTION)

    @property
    def size(self) -> str:
        """In degrees and centimetres of each metre."""
        degrees, cm = np.degrees(np.linalg.norm(self.per_m[:3])), 100.0 * np.linalg.norm(self.per_m[3:])
        parts = [f"{degrees:.2g} degrees"] * bool(degrees) + [f"{cm:.2g} cm"] * bool(cm)
        return f"{' and '.join(parts)} in each metre"

    @property
    def doubt(self) -> str:
        """Where it is not believed, for the user."""
        return (
            f"the map may be wrong: its closures fit far better if the odometry of {self.robot} errs by {self.size},"
            " which is more than a steady error can be; closures may be false where neighbouring places look alike"
        )

    @property
    def sentence(self) -> str:
        """For the user."""
        return f"the odometry of {self.robot} errs steadily, by {self.size}: closures tell, and it is corrected"


def chained(steps: FloatArray) -> FloatArray:
    """Products `(N, 4, 4)` of the first 1, 2, ... N steps `(N, 4, 4)`."""
    poses, reach = steps.copy(), 1
    while reach < len(poses):
        poses[reach:] = poses[:-reach] @ poses[reach:]
        reach *= 2
    return poses


def _moved_along(keyframes: Trajectory, poses: FloatArray) -> Trajectory | None:
    """The finer trajectory, each pose as odometry has it from the keyframe before, whose poses are `(N, 4, 4)` now."""
    finer = keyframes.finer
    if finer is None:
        return None
    before = np.maximum(np.searchsorted(keyframes.stamps_ns, finer.stamps_ns, side="right") - 1, 0)
    return replace(finer, poses=poses[before] @ se3.between(keyframes.poses[before], finer.poses))
