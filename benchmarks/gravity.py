"""Gravity, loops within one robot and GNSS along recorded odometry: what they leave of its drift.

    python benchmarks/gravity.py [--only ROW ...] [--seeds 5]

Each row prints what was measured and the goal.  Recordings come from `WICLOSURE_DATA`; closures and directions up are
made of ground truth with the noise that each row states.
"""

from __future__ import annotations

import argparse
import lzma
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

import numpy as np
from back_end import ate_m
from kitti import DATA, FRAME_NS, Team, every, lidar_poses, thirds
from odometry import PackedScans
from rosbags.rosbag2 import StoragePlugin, Writer
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.config import PcmSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.drift import DriftModel
from wiclosure.frontends.config import (
    IntraRobotLoopSettings,
    KeyframeSettings,
    MatchingSettings,
    OdometrySettings,
    ScanContextSettings,
)
from wiclosure.frontends.front_end import OdometryRun, describe_all
from wiclosure.frontends.front_end_result import FrontEndResult
from wiclosure.frontends.inertial.estimate import estimate_up
from wiclosure.frontends.inertial.gravity import level_rotation
from wiclosure.frontends.keyframes import KeyframeSelector
from wiclosure.frontends.moving_objects import standing
from wiclosure.frontends.odometry.recorded_odometry import RecordedOdometry
from wiclosure.frontends.odometry.sweep import within_range
from wiclosure.frontends.place_recognition.intra_robot_loops import intra_robot_loops
from wiclosure.frontends.place_recognition.matching import match, spread_out
from wiclosure.frontends.registration.registration import Registration
from wiclosure.pipeline.data.navigation.reader import read_imu
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.sources.messages.ros_types import typestore
from wiclosure.simulation.scenario import Scenario
from wiclosure.simulation.scenarios.registry import ScenarioSettings, make_scenario
from wiclosure.simulation.sensors.imu import ImuSettings, simulate_imu
from wiclosure.types import (
    BoolArray,
    Closure,
    EarthMeasurements,
    Float32Array,
    FloatArray,
    ImuLog,
    KeyframeId,
    Trajectory,
    UpDirections,
)

CLOSURE_SIGMA = np.repeat([0.005, 0.03], 3)
UP_SIGMA_RAD = np.radians(0.5)


def recorded_imu() -> tuple[ImuLog, Trajectory]:
    """The handheld recording: 100 Hz IMU in the axes of its LiDAR-inertial trajectory, whose z is up."""
    folder = DATA / "imu_continuous"
    with lzma.open(folder / "imu.txt.xz", "rt") as file:
        samples = np.loadtxt(file)
    rows = np.loadtxt(folder / "traj.txt")
    poses = se3.from_rotation_translation(Rotation.from_quat(rows[:, 4:8]).as_matrix(), rows[:, 1:4])
    imu_ns, odometry_ns = (
        np.rint((seconds - rows[0, 0]) * 1e9).astype(np.int64) for seconds in (samples[:, 0], rows[:, 0])
    )
    return ImuLog(imu_ns, samples[:, 1:4], samples[:, 4:7]), Trajectory("handheld", odometry_ns, poses)


def imu(_: argparse.Namespace) -> None:
    """Tilt and mounting on the handheld recording."""
    log, odometry = recorded_imu()
    keyframes = odometry.keyframes(np.arange(0, len(odometry), 10))
    off, angle, seconds = [], [], []
    for seed in range(10):
        hidden = Rotation.random(random_state=seed).as_matrix()
        began = time.perf_counter()
        found = estimate_up(log.turned(hidden.T), odometry, keyframes)
        seconds.append(time.perf_counter() - began)
        assert found.up is not None
        assert found.mounting is not None
        off.append(found.up.angles_off(keyframes.poses[:, :3, :3]))
        angle.append(Rotation.from_matrix(found.mounting.R_body_imu @ hidden.T).magnitude())
    print(
        f"imu_continuous, 10 hidden mountings: tilt {np.degrees(np.sqrt(np.mean(np.square(off)))):.2f} degrees rms"
        f" (goal 0.3); mounting found to {np.degrees(max(angle)):.3f} degrees (goal 1); {np.median(seconds):.2f} s for"
        f" {np.ptp(log.stamps_ns) * 1e-9:.0f} s"
    )


def levelled(team: Team) -> Team:
    """Each robot's odometry in a frame whose z is that of the ground truth's at its start."""
    turned = {}
    for robot, odometry in team.odometry.items():
        R = level_rotation(team.truth[robot].poses[0, :3, :3].T[:, 2])
        turned[robot] = odometry.moved(se3.from_rotation_translation(R, np.zeros(3)))
    return Team(team.truth, turned)


def up_of(truth: Trajectory, rows: np.ndarray, rng: np.random.Generator) -> UpDirections:
    """True directions up with noise."""
    noise = Rotation.from_rotvec(rng.normal(0.0, UP_SIGMA_RAD, (len(rows), 3))).as_matrix()
    up = np.einsum("nij,nj->ni", noise, truth.poses[rows, 2, :3])
    return UpDirections(rows, up, np.full(len(rows), UP_SIGMA_RAD))


def closures_between(
    truth: dict[str, Trajectory], reach_m: float, every: int, rng: np.random.Generator, sigma: FloatArray
) -> list[Closure]:
    """The nearest pair of each keyframe with each other robot, thinned, measured with noise."""
    names, found = list(truth), []
    for n, a in enumerate(names):
        for b in names[n + 1 :]:
            distance, near = cKDTree(truth[b].positions).query(truth[a].positions)
            near = np.asarray(near)
            rows = np.flatnonzero(distance < reach_m)[::every]
            T = se3.between(truth[a].poses[rows], truth[b].poses[near[rows]])
            T = T @ se3.exp(rng.normal(size=(len(rows), 6)) * sigma)
            found += [
                Closure.from_measurement(KeyframeId(a, int(i)), KeyframeId(b, int(j)), T_ab, np.diag(sigma**2))
                for i, j, T_ab in zip(rows, near[rows], T, strict=True)
            ]
    return found


def kitti_08(arguments: argparse.Namespace) -> None:
    """Thirds of KITTI 08 with recorded odometry, merged with and without gravity."""
    team = thirds("08").keyframes(1.0)
    sound = team.without_impossible()
    lost = sum(map(len, team.truth.values())) - sum(map(len, sound.truth.values()))
    merged_with_gravity("KITTI 08 in thirds", levelled(team), arguments)
    merged_with_gravity(f"the same without {lost} keyframes of impossible ground truth", levelled(sound), arguments)


def merged_with_gravity(name: str, team: Team, arguments: argparse.Namespace) -> None:
    """Errors with and without directions up, for several spacings of them."""
    true = {robot: t.poses for robot, t in team.truth.items()}
    for spacing in (1, 10, 30):
        errors, seconds, count = [], [], 0
        for seed in range(arguments.seeds):
            rng = np.random.default_rng(seed)
            closures = closures_between(team.truth, 5.0, 1, rng, CLOSURE_SIGMA)
            up = {robot: up_of(t, np.arange(0, len(t), spacing), rng) for robot, t in team.truth.items()}
            for earth in (EarthMeasurements(), EarthMeasurements(up)):
                began = time.perf_counter()
                result = optimise(team.odometry, closures, earth=earth)
                seconds.append(time.perf_counter() - began)
                errors.append(ate_m(result, true))
            count = len(closures)
        without, with_up = np.median(np.reshape(errors, (-1, 2)), axis=0)
        worst = max(errors[1::2])
        took = np.median(np.reshape(seconds, (-1, 2)), axis=0)
        print(
            f"{name}, recorded odometry, {count} closures of 3 cm: {without:.2f} m; with gravity of 0.5"
            f" degrees every {spacing} m {with_up:.2f} m, worst {worst:.2f} m (goal 2.0);"
            f" {took[0]:.2f} and {took[1]:.2f} s"
        )


def own_loops(arguments: argparse.Namespace) -> None:
    """KITTI 00 and 05 by one robot: the candidates that its odometry's drift allows, measured to 5 cm where true."""
    sigma = np.repeat([0.005, 0.05], 3)
    for sequence in ("00", "05"):
        poses = {kind: lidar_poses(kind, sequence) for kind in ("gt", "kiss_icp")}
        stamps_ns = np.arange(len(poses["gt"]), dtype=np.int64) * FRAME_NS
        odometry = Trajectory("alpha", stamps_ns, poses["kiss_icp"])
        rows = every(odometry, 1.0)
        keyframes, truth = odometry.keyframes(rows), poses["gt"][rows]
        began = time.perf_counter()
        pairs = intra_robot_loops(keyframes, IntraRobotLoopSettings())
        candidates_s = time.perf_counter() - began
        apart = np.linalg.norm(truth[pairs.index_a, :3, 3] - truth[pairs.index_b, :3, 3], axis=1)
        near = np.flatnonzero(apart < 5.0)
        kept = near[spread_out(pairs.index_a[near], pairs.index_b[near], apart[near], 3, len(rows) // 10)]
        errors, seconds, accepted = [], [], []
        for seed in range(arguments.seeds):
            rng = np.random.default_rng(seed)
            i, j = pairs.index_a[kept], pairs.index_b[kept]
            T = se3.between(truth[i], truth[j]) @ se3.exp(rng.normal(size=(len(kept), 6)) * sigma)
            closures = [
                Closure.from_measurement(
                    KeyframeId("alpha", int(a)), KeyframeId("alpha", int(b)), T_ab, np.diag(sigma**2)
                )
                for a, b, T_ab in zip(i, j, T, strict=True)
            ]
            began = time.perf_counter()
            checked = pairwise_consistent(closures, {"alpha": keyframes}, PcmSettings())
            result = optimise({"alpha": keyframes}, checked.closures)
            seconds.append(time.perf_counter() - began)
            errors.append(ate_m(result, {"alpha": truth}))
            accepted.append(len(result.accepted))
        plain = ate_m(optimise({"alpha": keyframes}, []), {"alpha": truth})
        print(
            f"KITTI {sequence}, one robot: odometry {plain:.2f} m, with {int(np.median(accepted))} of {len(kept)} loops"
            f" {np.median(errors):.2f} m (goal: half); {len(pairs)} candidates in {candidates_s:.1f} s, estimate"
            f" {np.median(seconds):.1f} s"
        )


def moving_objects(arguments: argparse.Namespace) -> None:
    """Traffic on simulated streets: how many of its points leave the map, and how many of all others stay."""
    for seed in range(arguments.seeds):
        settings = ScenarioSettings.model_validate({"seed": seed, "robots": 1, "traffic": {"cars": 12, "walkers": 12}})
        clouds, poses, moving, voxel_m = labelled_keyframes(make_scenario("city", settings))
        began = time.perf_counter()
        stays = np.concatenate(list(standing(clouds, poses, voxel_m)))
        seconds = time.perf_counter() - began
        print(
            f"city, seed {seed}: {moving.sum()} of {len(moving)} points of {len(clouds)} keyframes are of cars and"
            f" walkers; {1 - stays[moving].mean():.1%} of them leave, {stays[~moving].mean():.2%} of all others stay;"
            f" {seconds / len(clouds) * 1e3:.0f} ms a keyframe"
        )


def labelled_keyframes(world: Scenario) -> tuple[list[Float32Array], FloatArray, BoolArray, float]:
    """Keyframes' clouds and true poses, which of all their points move, and how finely they are thinned."""
    source, truth = world.scan_source("alpha"), world.ground_truth("alpha")
    odometry, selector = RecordedOdometry(OdometrySettings(), truth), KeyframeSelector()
    clouds, poses, labels = [], [], []
    for index in range(len(source)):
        if selector.select(truth.poses[index + 1]):
            scan, of_traffic = source.labelled(index)
            _, pose, points = odometry.register(scan)
            _, nearest = cKDTree(points).query(odometry.thinned)
            clouds.append(odometry.thinned)
            poses.append(pose)
            labels.append(of_traffic[within_range(scan.points, OdometrySettings())][nearest])
    return clouds, np.array(poses), np.concatenate(labels), odometry.voxel_size_m / 2


def bag_of_imu(_: argparse.Namespace) -> None:
    """Ten minutes of IMU at 400 Hz between clouds of 50 kB at 10 Hz: reading it, and finding up, per scan."""
    truth = make_scenario("city", ScenarioSettings(robots=1)).ground_truth("alpha")
    log = simulate_imu(make_scenario("city").robots["alpha"], ImuSettings(rate_hz=400.0), np.random.default_rng(0))
    seconds = 600
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot"
        write_imu_bag(path, np.resize(log.acceleration, (400 * seconds, 3)), seconds)
        began = time.perf_counter()
        read, remarks = read_imu("robot", RobotRecording(path, imu_pose=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)))
        reading_s = time.perf_counter() - began
    assert read is not None, remarks
    began = time.perf_counter()
    estimate_up(log, truth, truth.keyframes(np.arange(0, len(truth), 3)), np.eye(4))
    finding_s = (time.perf_counter() - began) * seconds / (np.ptp(log.stamps_ns) * 1e-9)
    each_ms = (reading_s + finding_s) / (10 * seconds) * 1e3
    print(
        f"{len(read.log)} samples at 400 Hz of {seconds} s: read in {reading_s:.1f} s, up found in {finding_s:.1f} s,"
        f" so {each_ms:.2f} ms a scan; a scan's odometry takes 45 ms and more, {each_ms / 45:.1%} (goal: 3 %)"
    )


def write_imu_bag(path: Path, acceleration: FloatArray, seconds: int) -> None:
    """An MCAP bag of samples, and of messages as large as thinned clouds between them."""
    store = typestore("cdr")
    make = {name: store.types[f"{of}/msg/{name}"] for of, name in (
        ("builtin_interfaces", "Time"), ("std_msgs", "Header"), ("geometry_msgs", "Vector3"),
        ("geometry_msgs", "Quaternion"), ("sensor_msgs", "Imu"), ("std_msgs", "String"))}  # fmt: skip
    still, none, start_ns = make["Quaternion"](0.0, 0.0, 0.0, 1.0), np.zeros(9), 1_700_000_000 * 10**9
    with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        imu = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        cloud = writer.add_connection("/cloud", "std_msgs/msg/String", typestore=store)
        large = store.serialize_cdr(make["String"]("x" * 50_000), "std_msgs/msg/String")
        for number, felt in enumerate(acceleration.tolist()):
            stamp_ns = start_ns + number * 2_500_000
            header = make["Header"](make["Time"](stamp_ns // 10**9, stamp_ns % 10**9), "imu")
            sample = make["Imu"](
                header, still, none, make["Vector3"](0.0, 0.0, 0.1), none, make["Vector3"](*felt), none
            )
            writer.write(imu, stamp_ns, store.serialize_cdr(sample, "sensor_msgs/msg/Imu"))
            if number % 40 == 0:
                writer.write(cloud, stamp_ns, large)


def indoor(_: argparse.Namespace) -> None:
    """KISS-ICP in rooms at 2 Hz, where it loses its hold, and the loops of one robot alone."""
    scans = PackedScans(DATA / "indoor_loop" / "scans.npz")
    with np.load(DATA / "indoor_loop" / "scans.npz") as pack:
        poses = pack["poses"]
    run = OdometryRun(OdometrySettings(), [KeyframeSettings()], "alpha")
    for k in range(len(scans)):
        run.process(scans.scan(k))
    (followed,) = run.results()
    front = FrontEndResult.of("alpha", DriftModel(), followed, describe_all(followed.clouds, ScanContextSettings()))
    truth, revisits = poses[front.keyframe_indices], IntraRobotLoopSettings()
    settings = MatchingSettings(budget=max(1, round(len(truth) / revisits.keyframes_per_loop)))
    proposed = match(intra_robot_loops(front.keyframes, revisits), front.descriptors, front.descriptors, settings)
    registration = Registration()
    measured = [registration.verify(c, *(front.clouds[k.index] for k in (c.query, c.match))) for c in proposed.closures]
    result = optimise(
        {"alpha": front.keyframes}, pairwise_consistent(measured, {"alpha": front.keyframes}, PcmSettings()).closures
    )
    plain = ate_m(optimise({"alpha": front.keyframes}, []), {"alpha": truth})
    apart = np.linalg.norm(truth[:, None, :3, 3] - truth[None, :, :3, 3], axis=2)
    true_m = Trajectory("alpha", front.keyframes.stamps_ns, truth).distance
    a, b = np.nonzero((true_m[None] - true_m[:, None] >= revisits.min_travel_m) & (apart <= 5.0))
    estimate = result.trajectories["alpha"].poses
    off = se3.between(se3.between(truth[a], truth[b]), se3.between(estimate[a], estimate[b]))
    recovered = np.linalg.norm(off[:, :3, 3], axis=1) < 1.0
    print(
        f"indoor_loop: {len(followed.found_again)} scans found again, {len(front.slips)} slips; odometry {plain:.2f} m,"
        f" with {len(result.accepted)} of {len(measured)} loops {ate_m(result, {'alpha': truth}):.2f} m;"
        f" {recovered.sum()} of {len(recovered)} pairs of keyframes within 5 m recovered to 1 m (goal 90 %)"
    )


ROWS: dict[str, Callable[[argparse.Namespace], None]] = {
    "imu": imu,
    "kitti08": kitti_08,
    "loops": own_loops,
    "moving": moving_objects,
    "bag": bag_of_imu,
    "indoor": indoor,
}


def main() -> None:
    """Prints the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=list(ROWS), nargs="+", default=list(ROWS))
    parser.add_argument("--seeds", type=int, default=5)
    arguments = parser.parse_args()
    for name in arguments.only:
        ROWS[name](arguments)


if __name__ == "__main__":
    main()
