"""Is the simulation believable?  KISS-ICP's drift and scan context distances on it, beside those of recorded scans.

    python benchmarks/simulation.py [--scans 1400] [--seed 0] [--points-per-voxel 10] [--picture FILE.png]

Drift is KITTI's figure: the error of displacements over 100 to 800 m, percent of their length; where the drive is too
short for that, the error at its end over the distance.  It takes minutes; `--scans 0` leaves it out.  What drift leaves
of a merged map is shown by recorded KISS-ICP odometry of KITTI 08 in thirds, joined by nearly perfect closures.  Scan
context
distances are of scans a metre apart along one drive, by how far apart they were taken, and of different places.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
from kitti import DATA, every, lidar_poses, thirds
from odometry import PackedScans
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.config import PoseGraphSettings
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.frontends.config import OdometrySettings, ScanContextSettings
from wiclosure.frontends.odometry.kiss_odometry import KissOdometry
from wiclosure.frontends.place_recognition.scan_context import ColumnSpectra, compare_descriptors, describe
from wiclosure.simulation import Scenario, ScenarioSettings, make_scenario
from wiclosure.types import Closure, Float32Array, FloatArray, IntArray, KeyframeId, Trajectory

LENGTHS_M = range(100, 801, 100)
APART_M = (0, 2, 5, 10, 20, 40, np.inf)
LOOPS = {"05": (540, 1319), "08": (720, 1500)}
"""Frames of KITTI of which raw scans are at hand: 8.8 m and 28 degrees apart; 3.2 m, opposite directions."""

STRETCH_SCANS = 500


@dataclass(frozen=True)
class Views:
    """What a drive looked like, once a metre: descriptors `(K, rings, sectors)` and true positions `(K, 3)`."""

    descriptors: Float32Array
    positions: FloatArray

    @classmethod
    def simulated(cls, scenario: Scenario, robot: str) -> Views:
        """The first stretch of that robot."""
        scans, truth = scenario.scan_source(robot), scenario.ground_truth(robot)
        rows = every(truth.subset(np.arange(min(len(scans), STRETCH_SCANS))), 1.0)
        return cls(np.stack([described(scans.scan(int(row)).points) for row in rows]), truth.positions[rows])

    @classmethod
    def recorded(cls, name: str) -> Views:
        """One of the packed recordings; positions by OXTS or SLAM."""
        path = DATA / name / "scans.npz"
        scans, poses = PackedScans(path), np.load(path)["poses"]
        truth = Trajectory(name, np.arange(len(poses)) * 10**9, poses)
        rows = every(truth, 1.0)
        return cls(np.stack([described(scans.scan(int(row)).points) for row in rows]), truth.positions[rows])


def described(points: FloatArray | Float32Array) -> Float32Array:
    return describe(points, ScanContextSettings())


def followed(scenario: Scenario, robot: str, scans: int, settings: OdometrySettings) -> tuple[FloatArray, FloatArray]:
    """Truth and KISS-ICP's poses `(N, 4, 4)` of the first scans of that robot."""
    odometry, source = KissOdometry(settings), scenario.scan_source(robot)
    found = [odometry.register(source.scan(index))[:2] for index in range(min(scans, len(source)))]
    stamps_ns = np.array([stamp_ns for stamp_ns, _ in found], np.int64)
    return scenario.ground_truth(robot).at(stamps_ns), np.array([pose for _, pose in found])


def drift_percent(truth: FloatArray, odometry: FloatArray) -> tuple[float, str]:
    """Error of displacements, percent of the path, and over what it was taken."""
    path_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))])
    errors: list[FloatArray] = []
    for length_m in LENGTHS_M:
        start = np.arange(0, len(truth), 10)
        end = np.searchsorted(path_m, path_m[start] + length_m)
        start, end = start[end < len(truth)], end[end < len(truth)]
        errors.append(_displacement_error(truth, odometry, start, end) / length_m)
    found = np.concatenate(errors)
    if len(found):
        return 100 * float(found.mean()), f"{len(found)} segments of 100-{min(int(path_m[-1]), 800)} m"
    whole = _displacement_error(truth, odometry, np.array([0]), np.array([len(truth) - 1]))
    return 100 * float(whole[0] / path_m[-1]), f"end of {path_m[-1]:.0f} m"


def _displacement_error(truth: FloatArray, odometry: FloatArray, start: IntArray, end: IntArray) -> FloatArray:
    apart = se3.between(se3.between(truth[start], truth[end]), se3.between(odometry[start], odometry[end]))
    return np.asarray(np.linalg.norm(apart[:, :3, 3], axis=1))


def distances_apart(drive: Views) -> list[FloatArray]:
    """Scan context distances within one drive, for each range of `APART_M`."""
    spectra = ColumnSpectra.of(drive.descriptors)
    i, j = np.triu_indices(len(drive.descriptors), 1)
    distance, _ = compare_descriptors(spectra, spectra, i, j)
    apart_m = np.linalg.norm(drive.positions[i] - drive.positions[j], axis=1)
    return [distance[(apart_m >= low) & (apart_m < high)] for low, high in pairwise(APART_M)]


def distances_between(first: Float32Array, second: Float32Array) -> FloatArray:
    """Scan context distances between keyframes of two different places."""
    i, j = np.meshgrid(np.arange(len(first)), np.arange(len(second)), indexing="ij")
    return compare_descriptors(ColumnSpectra.of(first), ColumnSpectra.of(second), i.ravel(), j.ravel())[0]


def recorded_team_error() -> tuple[int, float, float]:
    """KITTI 08 in thirds with recorded odometry, closures good to 3 cm and 0.3 degrees wherever two pass within 5 m.

    Returns:
        How many closures, ATE of the merged team, and of its robots each aligned by itself, m.
    """
    team, rng = thirds("08").keyframes(1.0), np.random.default_rng(0)
    covariance = np.diag(np.repeat([0.005**2, 0.03**2], 3))
    closures = []
    for a, b in combinations(team.truth.values(), 2):
        apart_m = np.linalg.norm(a.positions[:, None] - b.positions[None], axis=2)
        for i in np.flatnonzero(apart_m.min(axis=1) < 5.0).tolist():
            j = int(apart_m[i].argmin())
            T = se3.between(a.poses[i], b.poses[j]) @ se3.exp(rng.multivariate_normal(np.zeros(6), covariance))
            ends = KeyframeId(a.robot, i), KeyframeId(b.robot, j)
            closures.append(Closure.from_measurement(*ends, T, covariance))
    merged = optimise(team.odometry, closures, PoseGraphSettings()).trajectories
    joint = aligned_error(list(merged.values()), [team.truth[robot] for robot in merged])
    alone = [aligned_error([team.odometry[robot]], [truth]) for robot, truth in team.truth.items()]
    return (
        len(closures),
        float(np.sqrt(np.square(joint).mean())),
        float(np.sqrt(np.square(np.concatenate(alone)).mean())),
    )


def aligned_error(found: list[Trajectory], truth: list[Trajectory]) -> FloatArray:
    """Distances `(N,)` from truth under the one rigid transform that fits all of them best."""
    p, q = (np.concatenate([t.positions for t in of]) for of in (found, truth))
    R, _ = Rotation.align_vectors(q - q.mean(axis=0), p - p.mean(axis=0))
    return np.asarray(np.linalg.norm(R.apply(p - p.mean(axis=0)) + q.mean(axis=0) - q, axis=1))


def print_drift(name: str, truth: FloatArray, odometry: FloatArray) -> None:
    percent, over = drift_percent(truth, odometry)
    print(f"{name:40} {percent:6.2f} %  {over}")


def print_distances(name: str, drive: Views) -> None:
    cells = [quantiles(d) if len(d) > 20 else "-" for d in distances_apart(drive)]
    print(f"{name:30}" + "".join(f"{cell:>18}" for cell in cells))


def quantiles(distances: FloatArray) -> str:
    """Median (10-90 %)."""
    low, middle, high = np.quantile(distances, (0.1, 0.5, 0.9))
    return f"{middle:.2f} ({low:.2f}-{high:.2f})"


def recorded_loops() -> dict[str, Float32Array]:
    """Descriptors of the two recorded revisits."""
    files = {s: [DATA / "kitti_loop_pairs" / s / f"{frame:06d}.bin" for frame in frames] for s, frames in LOOPS.items()}
    return {
        sequence: np.stack([described(np.fromfile(p, np.float32).reshape(-1, 4)[:, :3]) for p in paths])
        for sequence, paths in files.items()
    }


def simulated_loop(scenario: Scenario) -> Float32Array:
    """Descriptors of the same two frames of 08 as the simulation sees them."""
    sources = [scenario.scan_source(robot) for robot in scenario.robots]
    found = []
    for frame in LOOPS["08"]:
        part, first = next(
            (source, start)
            for source, start in zip(sources, (0, 1357, 2714), strict=True)
            if start <= frame < start + 1357
        )
        found.append(described(part.scan(frame - first).points))
    return np.stack(found)


def draw(drives: dict[str, Views], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    labels = [f"{low:g}-{high:g}" if np.isfinite(high) else f"> {low:g}" for low, high in pairwise(APART_M)]
    for number, (name, drive) in enumerate(drives.items()):
        found = {k: d for k, d in enumerate(distances_apart(drive)) if len(d) > 20}
        x = np.array(list(found)) + 0.12 * (number - (len(drives) - 1) / 2)
        low, mid, high = np.array([np.quantile(d, (0.1, 0.5, 0.9)) for d in found.values()]).T
        axes.errorbar(x, mid, [mid - low, high - mid], fmt="o", capsize=3, label=name)
    axes.set_xticks(range(len(labels)), labels)
    axes.set_xlabel("metres between the two scans")
    axes.set_ylabel("scan context distance: median, 10-90 %")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=2, frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=1400, help="of each simulated robot, at most, for the drift")
    parser.add_argument("--seed", type=int, default=0)
    default = OdometrySettings().points_per_voxel
    parser.add_argument("--points-per-voxel", type=int, default=default, help="of KISS-ICP's map; its own are 20")
    parser.add_argument("--picture", type=Path, default=Path("simulation_scan_context.png"))
    wanted = parser.parse_args()
    settings = OdometrySettings(points_per_voxel=wanted.points_per_voxel)
    kitti08 = make_scenario(
        "kitti08", ScenarioSettings(poses=DATA / "kitti_odometry" / "gt" / "08.txt", seed=wanted.seed)
    )
    city, shell = (make_scenario(name, ScenarioSettings(seed=wanted.seed)) for name in ("city", "shell-space"))
    if wanted.scans:
        print("Drift of KISS-ICP")
        for sequence in ("00", "05", "08"):
            print_drift(f"recorded KITTI {sequence}", lidar_poses("gt", sequence), lidar_poses("kiss_icp", sequence))
        for scenario in (kitti08, city, shell):
            for robot in ("alpha", "beta"):
                print_drift(f"simulated {scenario.name} {robot}", *followed(scenario, robot, wanted.scans, settings))
    count, joint_m, alone_m = recorded_team_error()
    print(f"recorded KITTI 08 in thirds, {count} nearly perfect closures: ATE {joint_m:.2f} m, alone {alone_m:.2f} m\n")

    recorded = {
        "KITTI drive 0926_0005, HDL-64": Views.recorded("kitti_raw_0926_0005"),
        "indoor loop, 64 beams": Views.recorded("indoor_loop"),
    }
    simulated = {
        "kitti08 alpha, HDL-64": Views.simulated(kitti08, "alpha"),
        "kitti08 gamma, HDL-64": Views.simulated(kitti08, "gamma"),
        "city alpha, OS1-64": Views.simulated(city, "alpha"),
        "shell-space alpha, VLP-16": Views.simulated(shell, "alpha"),
    }
    print("\nScan context distance by metres apart: median (10-90 %)")
    print(" " * 30 + "".join(f"{f'{low:g} to {high:g}':>18}" for low, high in pairwise(APART_M)))
    for name, views in (recorded | simulated).items():
        print_distances(name, views)

    loops, own = recorded_loops(), simulated_loop(kitti08)
    strangers = distances_between(
        recorded["KITTI drive 0926_0005, HDL-64"].descriptors, np.concatenate(list(loops.values()))
    )
    apart = distances_between(*(simulated[f"kitti08 {robot}, HDL-64"].descriptors for robot in ("alpha", "gamma")))
    print("\nRevisits, and different places")
    print(f"recorded 05, 8.8 m, 28 degrees    {distances_between(*np.split(loops['05'], 2))[0]:.2f}")
    print(f"recorded 08, 3.2 m, reverse       {distances_between(*np.split(loops['08'], 2))[0]:.2f}")
    print(f"simulated, the same frames of 08  {distances_between(*np.split(own, 2))[0]:.2f}")
    print(f"recorded, different places        {quantiles(strangers)}")
    print(f"simulated, different places       {quantiles(apart)}")
    pictured = {f"recorded: {name}": views for name, views in recorded.items()}
    pictured |= {f"simulated: {name}": views for name, views in simulated.items() if "gamma" not in name}
    draw(pictured, wanted.picture)
    print(f"\npicture in {wanted.picture}")


if __name__ == "__main__":
    main()
