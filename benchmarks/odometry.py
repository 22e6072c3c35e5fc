"""Our front end against a bare KISS-ICP loop over the same scans in the same run, and its memory.

Usage: python benchmarks/odometry.py [SCANS.npz] [--repeat-drive 4]

The two loops take turns scan by scan, so that a noisy machine disturbs both alike.  Memory is measured in one process
for each number of scans: the peak of the resident set (Linux: VmHWM, reset once the recording is loaded).
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import time
from pathlib import Path

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.config.config import DataConfig, MappingConfig
from kiss_icp.kiss_icp import KissICP

from wiclosure.frontends.config import KeyframeSettings, OdometrySettings, ScanContextSettings
from wiclosure.frontends.front_end import OdometryRun, describe_all
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.types import Scan, Trajectory

RECORDED = Path(os.environ.get("WICLOSURE_DATA", "../shared/data")) / "kitti_raw_0926_0005" / "scans.npz"


class PackedScans:
    """A recording in one file: quantised points `(3, N)`, their scale, and where each scan begins."""

    def __init__(self, path: Path) -> None:
        with np.load(path) as pack:
            self._xyz, self._offsets, self._scale = pack["xyz"], pack["offsets"], float(pack["scale"])
            self._stamps_ns = np.rint(pack["stamps"] * 1e9).astype(np.int64)

    def __len__(self) -> int:
        return len(self._stamps_ns)

    def scan(self, index: int) -> Scan:
        """The scan, its points as a source would give them."""
        points = self._xyz[:, self._offsets[index] : self._offsets[index + 1]].T * self._scale
        return Scan(int(self._stamps_ns[index]), np.ascontiguousarray(points))


def overhead(path: Path) -> None:
    scans = PackedScans(path)
    voxel_m = voxel_size_m(scans.scan(0).points)
    kiss = KissICP(KISSConfig(data=DataConfig(), mapping=MappingConfig(voxel_size=voxel_m)))
    ours = OdometryRun(OdometrySettings(), [KeyframeSettings()], "alpha")
    seconds_bare = seconds_ours = 0.0
    no_times = np.zeros(0)
    for index in range(len(scans)):
        scan = scans.scan(index)
        for turn in (index % 2, 1 - index % 2):
            started = time.perf_counter()
            if turn:
                kiss.register_frame(scan.points, no_times)
                seconds_bare += time.perf_counter() - started
            else:
                ours.process(scan)
                seconds_ours += time.perf_counter() - started
    (result,) = ours.results()
    descriptors = describe_all(result.clouds, ScanContextSettings())
    difference = float(np.abs(result.poses[-1] - kiss.last_pose).max())
    length_m = Trajectory("alpha", result.stamps_ns, result.poses).distance[-1]
    print(f"scans {len(scans)}, keyframes {len(result.clouds)}, path {length_m:.2f} m")
    print(f"bare KISS-ICP  {seconds_bare:6.2f} s")
    print(f"our front end  {seconds_ours:6.2f} s, ratio {seconds_ours / seconds_bare:.3f}")
    print(f"  of it odometry {result.seconds:.2f} s; descriptors, besides, {descriptors.seconds:.2f} s")
    print(f"largest difference of the last pose {difference:.1e}")


def peak_resident_mb() -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024


def memory(path: Path, laps: int) -> None:
    scans = PackedScans(path)
    Path("/proc/self/clear_refs").write_text("5")
    before_mb = peak_resident_mb()
    run = OdometryRun(OdometrySettings(), [KeyframeSettings()], "alpha")
    for lap in range(laps):
        # There and back again, so that the drive never jumps.
        order = range(len(scans)) if lap % 2 == 0 else reversed(range(len(scans)))
        for n, index in enumerate(order):
            points = scans.scan(index).points
            run.process(Scan((lap * len(scans) + n) * 100_000_000, points))
    peak_mb = peak_resident_mb()
    (result,) = run.results()
    clouds_mb = sum(c.nbytes for c in result.clouds) / 2**20
    print(
        f"{laps * len(scans)} scans, {len(result.clouds)} keyframes: peak {peak_mb:.0f} MB,"
        f" {peak_mb - before_mb:.0f} MB above the start; keyframe clouds {clouds_mb:.0f} MB"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scans", type=Path, nargs="?", default=RECORDED)
    parser.add_argument("--repeat-drive", type=int, default=4, help="laps of the longer memory test")
    arguments = parser.parse_args()
    overhead(arguments.scans)
    fresh = multiprocessing.get_context("spawn")
    for laps in (1, arguments.repeat_drive):
        process = fresh.Process(target=memory, args=(arguments.scans, laps))
        process.start()
        process.join()


if __name__ == "__main__":
    main()
