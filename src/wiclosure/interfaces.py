"""The seams of the pipeline: what can be exchanged, and what a replacement must do."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import Enum
from typing import Protocol, runtime_checkable

from wiclosure.types import BoolArray, FilterResult, Float32Array, FloatArray, Scan, Trajectory, WirelessLog


@runtime_checkable
class ScanSource(Protocol):
    """A recording of one LiDAR, read one scan at a time.

    Iterating twice gives the same scans twice.  A source yields what it finds; empty scans and stamps out of order are
    left out, counted and reported in one place for all sources (`wiclosure.frontends.front_end`).
    """

    @property
    def description(self) -> str:
        """One line for the user: what is read, and from where."""
        ...

    def __len__(self) -> int:
        """How many scans the recording announces."""
        ...

    def __iter__(self) -> Iterator[Scan]:
        """The scans in the order of the recording."""
        ...


class Hold(Enum):
    """How an odometry stands with a scan."""

    HELD = "held"  # or nothing tells otherwise
    FOUND_AGAIN = "found again"  # it had settled where the scan does not fit, and found the place by a search
    LOST = "lost"  # the scan fits nowhere


class Odometry(Protocol):
    """Follows one LiDAR through its scans, in order of time."""

    @property
    def voxel_size_m(self) -> float:
        """The length that its map, and with it keyframes' clouds, are thinned by; NaN until the first scan tells."""
        ...

    def covers(self, scan: Scan) -> bool:
        """Whether this scan can be followed; one that cannot is left out, counted and reported."""
        ...

    def register(self, scan: Scan) -> tuple[int, FloatArray, FloatArray]:
        """Next scan in; pose and deskewed points out.

        Returns:
            stamp_ns of the pose, that of the last point measured; `T_odom_body (4, 4)`; and the points `(N, 3)` within
            range, in the body's axes at that instant.
        """
        ...

    @property
    def kept(self) -> BoolArray:
        """`(M,)` which of the last scan's points `register` returned, in their order."""
        ...

    @property
    def hold(self) -> Hold:
        """How it stands with the last scan: where it lost one, the step to it counts as unknown."""
        ...

    @property
    def thinned(self) -> FloatArray | Float32Array:
        """The last scan's points `(M, 3)` in the body's axes, one per voxel of half `voxel_size_m`.

        Raises:
            ValueError: no scan was registered yet.
        """
        ...


class CandidateFilter(Protocol):
    """Chooses the pairs of keyframes that are worth comparing, before any scan is looked at."""

    @property
    def name(self) -> str:
        """Registry name."""
        ...

    def candidates(self, trajectories: Mapping[str, Trajectory], wireless: WirelessLog) -> FilterResult:
        """Kept pairs between the keyframe trajectories of all robots.

        Args:
            trajectories: keyframe odometry by the robot's name, which it carries too; indices in the result refer to
                these poses. Each robot has its own, unknown odometry frame. Stamps of all robots come from one clock.
            wireless: measurements and headings of these robots.
        """
        ...
