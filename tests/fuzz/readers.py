"""Every reader of files, with files that it reads: what is mutated, and what must come of it."""

from __future__ import annotations

import gzip
import json
import lzma
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wiclosure.backends.graph_files.team import read_graphs
from wiclosure.drift import DriftModel
from wiclosure.evidence import RegistrationEvidence
from wiclosure.formats.candidates_csv import read_candidates, write_candidates
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.formats.radio.wsr import read_wsr_profiles
from wiclosure.formats.trajectories.kitti_poses import read_kitti_poses, write_kitti_poses
from wiclosure.formats.trajectories.trajectory_file import read_trajectory
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.formats.unpacking import zstd
from wiclosure.frontends.front_end_result import Descriptors, FrontEndCounts, OdometryResult
from wiclosure.pipeline.config import Config, dump_config, load_config
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros1_bag, write_ros2_bag
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.evaluation.evaluate import evaluate_trajectories
from wiclosure.pipeline.radio.read import read_radio
from wiclosure.pipeline.radio.words import sources_of_words
from wiclosure.pipeline.report.html.page import read_page, write_page
from wiclosure.pipeline.runtime.settings_text import nested_words
from wiclosure.pipeline.sources.info import recording_info
from wiclosure.pipeline.sources.navigation.tables import read_gnss_table, read_imu_table
from wiclosure.pipeline.sources.open import open_source
from wiclosure.pipeline.sources.poses.pose_topics import read_pose_topic
from wiclosure.pipeline.sources.wireless_topics import read_wireless_topics
from wiclosure.pipeline.stages import registration_store
from wiclosure.pipeline.stages.registrations import Registered, Start
from wiclosure.pipeline.stages.run_folder import read_evaluation_settings, read_metrics, read_trajectories
from wiclosure.types import (
    AoaPath,
    CandidatePairs,
    Heading,
    KeyframeId,
    Measured,
    Scan,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "backends/graph_files"), str(TESTS / "pipeline/sources")]

START_NS = 1_700_000_000_000_000_000
Numbers = Iterable[object]


@dataclass(frozen=True)
class Reader:
    """A kind of file.

    Args:
        is_text: decides how it is mutated, and how often.
        make: writes originals into a folder and names those that may be mutated.
        read: reads what lies in the folder; returns all numbers that came out.
        bound: of these; larger ones are garbage, unless something was said.
    """

    is_text: bool
    make: Callable[[Path], list[Path]]
    read: Callable[[Path], Numbers]
    bound: float = 1e8


# ------------------------------------------------------------------------------------------------------------ originals
def scans(count: int = 4, points: int = 200) -> list[Scan]:
    rng = np.random.default_rng(count)
    return [
        Scan(
            START_NS + n * 100_000_000,
            rng.normal(0, 20, (points, 3)).astype(np.float32).astype(float),
            np.linspace(0, 0.1, points),
            rng.uniform(size=points),
        )
        for n in range(count)
    ]


def trajectory(robot: str = "alpha", count: int = 30) -> Trajectory:
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = np.arange(count) * 0.5, np.sin(np.arange(count) / 5)
    return Trajectory(robot, START_NS + np.arange(count) * 10**8, poses, DriftModel())


def radio() -> WirelessLog:
    paths = (AoaPath(0.3, 0.17, 0.6, 0.1), AoaPath(-1.2, 0.2, 0.4))
    measured = [
        WirelessMeasurement(START_NS + n * 10**8, "alpha", "beta", 20.0 + n, 0.3, paths if n % 2 else ())
        for n in range(12)
    ]
    return WirelessLog(tuple(measured), (Heading(START_NS, "alpha", 1.57, 0.05),))


def text(name: str, content: str | Callable[[], str]) -> Callable[[Path], list[Path]]:
    """Makes one file of text."""

    def make(folder: Path) -> list[Path]:
        (folder / name).write_text(content if isinstance(content, str) else content(), encoding="utf-8")
        return [folder / name]

    return make


def by(name: str, write: Callable[[Path], object]) -> Callable[[Path], list[Path]]:
    """Makes one file by its writer."""

    def make(folder: Path) -> list[Path]:
        write(folder / name)
        return (
            sorted(p for p in (folder / name).rglob("*") if p.is_file())
            if (folder / name).is_dir()
            else [folder / name]
        )

    return make


EUROC = "#timestamp [ns],x,y,z,qw,qx,qy,qz\n" + "".join(
    f"{START_NS + n * 10**8},{n * 0.5},0.1,0.0,1.0,0.0,0.0,0.0\n" for n in range(20)
)
CSV = "stamp,robot,anchor,range,sigma\n" + "".join(f"{1.7e9 + n:.3f},alpha,beta,{20 + n}.5,0.3\n" for n in range(20))
IMU = "stamp,ax,ay,az,gx,gy,gz\n" + "".join(f"{1.7e9 + n / 100:.3f},0.1,0.0,9.81,0.0,0.01,0.0\n" for n in range(60))
GNSS = "stamp,latitude,longitude,height\n" + "".join(f"{1.7e9 + n:.3f},48.1,11.5,{500 + n}.0\n" for n in range(20))
PYFG = "VERTEX_SE2 0.1 A0 0.0 0.0 0.0\n" + "".join(f"EDGE_RANGE {n}.1 A{n} B{n} 2.85 0.01\n" for n in range(20))
DATASET = """robots:
  alpha: {scans: a.bag, topic: /points, odometry: a.tum, time_offset: 0.5, lidar_pose: [0, 0, 1, 0, 0, 0, 1]}
  beta:
    scans: a.bag
    ground_truth: a.tum
    odometry: a.tum
wireless:
  - radio.jsonl
  - {path: ranges.csv, unit: m, robots: {alpha: alpha, beta: beta}}
"""
OVERRIDES = ["keyframes.distance_m=2", "filter.random.seed=3", "registration.method=gicp", "drift={}"]


def wsr() -> str:
    def record(n: int) -> dict[str, object]:
        peaks = {"1": {"estimated_azimuth": -90.0 + n, "estimated_elevation": 60.0}}
        return {
            "a_INFO_Transmitting_robot": {"Name": "tx2", "groundtruth_azimuth": -80.0},
            "b_INFO_Receiving_robot": {"id": 9, "displacement_type": "3D"},
            "d_INFO_AOA_profile": {"Profile_variance": 0.7, "Top_N_peaks": peaks},
        }

    return json.dumps({str(n): [record(n)] for n in range(3)}, indent=1)


def dataset(folder: Path) -> list[Path]:
    write_ros1_bag(folder / "a.bag", scans(2, 50))
    write_tum(folder / "a.tum", trajectory())
    write_wireless_log(folder / "radio.jsonl", radio())
    (folder / "ranges.csv").write_text(CSV)
    (folder / "dataset.yaml").write_text(DATASET)
    return [folder / "dataset.yaml"]


def kitti(folder: Path) -> list[Path]:
    write_kitti_folder(folder / "k", [Scan(s.stamp_ns, s.points, None, s.intensity) for s in scans(8, 50)])
    write_kitti_poses(folder / "k/poses.txt", trajectory(count=8).poses)
    (folder / "k/calib.txt").write_text("P0: 1 0 0 0 0 1 0 0 0 0 1 0\nTr: 0 -1 0 0.1 0 0 -1 0.2 1 0 0 0.3\n")
    return [folder / "k" / name for name in ("times.txt", "poses.txt", "calib.txt")]


def run_folder(folder: Path) -> list[Path]:
    names = ("alpha", "beta")
    (folder / "config.yaml").write_text(dump_config(Config()))
    metrics = {
        "components": [{"robots": list(names)}],
        "filter": "none",
        "ate_m": {"team": 0.1},
        "seconds": {"total": 1.5},
    }
    (folder / "metrics.json").write_text(json.dumps(metrics, indent=1))
    for robot in names:
        write_tum(folder / f"{robot}.tum", trajectory(robot))
        write_tum(folder / f"{robot}_ground_truth.tum", trajectory(robot))
    return [p for p in folder.iterdir() if p.is_file()]


def kitti_poses(folder: Path) -> list[Path]:
    write_kitti_poses(folder / "a.txt", trajectory().poses)
    return [folder / "a.txt"]


def descriptors(path: Path) -> None:
    Descriptors(np.ones((3, 20, 60), np.float32), 1.0).save(path)


def candidates(path: Path) -> None:
    index, ones = np.arange(20), np.ones(20)
    pairs = CandidatePairs("alpha", "beta", index, index, ones, ones)
    write_candidates(path, [pairs], {r: trajectory(r) for r in ("alpha", "beta")})


def report(path: Path) -> None:
    packed = {"type": "bytes", "shape": [3], "data": "eJxjZGIGAAANAAc="}
    write_page(
        path, {"title": "a run", "verdict": "fine", "runs": [{"name": "one", "map": packed, "robots": [{"n": 1}]}]}
    )


def typed_bag(folder: Path) -> list[Path]:
    """Odometry beside scans and radio."""
    from rosbags.rosbag1 import Writer

    from wiclosure.pipeline.sources.messages.ros_types import typestore

    store = typestore("ros1")
    kinds = store.types
    stamp = kinds["builtin_interfaces/msg/Time"]
    with Writer(folder / "o.bag") as writer:
        connection = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
        for n in range(30):
            header = kinds["std_msgs/msg/Header"](seq=n, stamp=stamp(1_700_000_000, n * 10**7), frame_id="odom")
            pose = kinds["geometry_msgs/msg/Pose"](
                kinds["geometry_msgs/msg/Point"](n * 0.1, 0.0, 0.0),
                kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
            )
            zero = kinds["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
            message = kinds["nav_msgs/msg/Odometry"](
                header, "base",
                kinds["geometry_msgs/msg/PoseWithCovariance"](pose, np.eye(6).ravel()),
                kinds["geometry_msgs/msg/TwistWithCovariance"](
                    kinds["geometry_msgs/msg/Twist"](zero, zero), np.eye(6).ravel()
                ),
            )  # fmt: skip
            raw = store.serialize_ros1(message, "nav_msgs/msg/Odometry")
            writer.write(connection, START_NS + n * 10**7, raw)
    return [folder / "o.bag"]


def packed_bag(fmt: str) -> Callable[[Path], list[Path]]:
    """A ROS 1 bag with compressed chunks."""

    def make(folder: Path) -> list[Path]:
        from rosbags.rosbag1 import Reader as BagReader
        from rosbags.rosbag1 import Writer

        from wiclosure.pipeline.sources.messages.ros_types import typestore

        write_ros1_bag(folder / "plain", scans(3, 100))
        writer = Writer(folder / "a.bag")
        writer.set_compression(getattr(Writer.CompressionFormat, fmt))
        with writer, BagReader(folder / "plain") as reader:
            connection = writer.add_connection("/points", "sensor_msgs/msg/PointCloud2", typestore=typestore("ros1"))
            for _, stamp_ns, raw in reader.messages():
                writer.write(connection, stamp_ns, raw)
        (folder / "plain").unlink()
        return [folder / "a.bag"]

    return make


def packed_mcap(compression: str) -> Callable[[Path], list[Path]]:
    """An MCAP file with one compressed chunk and no index."""

    def make(folder: Path) -> list[Path]:
        import lz4.frame
        from mcap_bytes import MAGIC, Topic, mcap_bytes, record, string  # type: ignore[import-not-found]

        from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
        from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE, serialize, typestore

        store = typestore("cdr")
        sweeps = [
            (s.stamp_ns, bytes(serialize(store, "cdr", encode_scan(s, store), POINT_CLOUD_TYPE))) for s in scans(3, 100)
        ]
        content = mcap_bytes([Topic("/points", POINT_CLOUD_TYPE, sweeps)], footer=False)
        start = len(MAGIC) + 9 + int.from_bytes(content[len(MAGIC) + 1 : len(MAGIC) + 9], "little")
        packed = {"zstd": zstd.compress, "lz4": lz4.frame.compress}[compression](content[start:])
        head = b"".join(n.to_bytes(8, "little") for n in (START_NS, START_NS + 10**9, len(content) - start)) + bytes(4)
        chunk = record(6, head + string(compression) + len(packed).to_bytes(8, "little") + packed)
        path = folder / "a.mcap"
        path.write_bytes(content[:start] + chunk + record(15, bytes(4)) + record(2, bytes(20)) + MAGIC)
        return [path]

    return make


def ros2(storage: str, **more: object) -> Callable[[Path], list[Path]]:
    def make(folder: Path) -> list[Path]:
        write_ros2_bag(folder / "a", scans(), storage=storage, **more)  # type: ignore[arg-type]
        return [p for p in (folder / "a").iterdir() if p.suffix in {".mcap", ".db3"}]

    return make


def metadata(folder: Path) -> list[Path]:
    write_ros2_bag(folder / "a", scans(2, 50), storage="mcap")
    return [folder / "a/metadata.yaml"]


def cloud(suffix: str, how: str) -> Callable[[Path], list[Path]]:
    def make(folder: Path) -> list[Path]:
        from clouds.test_pcd import BAG_TO_PCD, columns_of, pcd_bytes  # type: ignore[import-not-found]
        from clouds.test_ply import ply_bytes  # type: ignore[import-not-found]
        from clouds.test_record_size import records  # type: ignore[import-not-found]

        path = folder / f"000000.{suffix}"
        if suffix == "pcd":
            path.write_bytes(pcd_bytes(BAG_TO_PCD, columns_of(BAG_TO_PCD, 200), how))
        elif suffix == "ply":
            path.write_bytes(ply_bytes(how, 200)[0])
        else:
            path.write_bytes(records("kitti", 500).tobytes())
        return [path]

    return make


def graph(form: str, pack: str = "") -> Callable[[Path], list[Path]]:
    def make(folder: Path) -> list[Path]:
        import conftest as graphs  # type: ignore[import-not-found]

        _, (path,) = graphs.written(form, 5, folder)
        if not pack:
            if path.suffix == ".jrl":
                path.write_text(json.dumps(json.loads(path.read_text()), indent=1))
            return [path]
        content, target = path.read_bytes(), path.with_name(path.name + pack)
        if pack == ".cbor":
            import cbor2

            target.write_bytes(cbor2.dumps(json.loads(content)))
        else:
            target.write_bytes({".gz": gzip.compress, ".xz": lzma.compress}[pack](content))
        path.unlink()
        return [target]

    return make


def odometry_entry(path: Path) -> None:
    path_of = trajectory()
    clouds = tuple(s.points.astype(np.float32) for s in scans(3, 60))
    stamps_ns = path_of.stamps_ns
    counts = FrontEndCounts(**dict.fromkeys(FrontEndCounts.__dataclass_fields__, 1))
    OdometryResult(stamps_ns, stamps_ns, path_of.poses, np.array([0, 10, 20]), clouds, counts, 1.0, 1.0).save(path)


def registration_entry(path: Path) -> None:
    measured = Measured(np.eye(4), np.eye(6), RegistrationEvidence(100, 0.9, 0.8, 0.1, None))
    start = Start(KeyframeId("alpha", 1), KeyframeId("beta", 2), np.eye(4).tobytes())
    registration_store._save({start: Registered(measured, True, "", 0.1)}, path)


# -------------------------------------------------------------------------------------------------------------- readers
def of_scans(path: Path, *, salvage: bool = False) -> Iterator[object]:
    recording_info(path, salvage=salvage)
    for scan in open_source(path, salvage=salvage):
        yield scan.points
        yield scan.times if scan.times is not None else 0.0
        yield scan.stamp_ns * 1e-9 / 100


def of_bag(path: Callable[[Path], Path]) -> Callable[[Path], Numbers]:
    """Read as it is, then for what can be saved."""

    def read(folder: Path) -> Numbers:
        from wiclosure.errors import InputError

        try:
            found = list(of_scans(path(folder)))
        except InputError:
            list(of_scans(path(folder), salvage=True))
            raise
        return found

    return read


def of_trajectory(found: Trajectory) -> Numbers:
    return [found.poses, found.stamps_ns * 1e-9 / 100]


def of_path(name: str) -> Callable[[Path], Numbers]:
    return lambda folder: of_trajectory(read_trajectory(folder / name, "alpha"))


def of_odometry_topic(folder: Path) -> Numbers:
    return of_trajectory(read_pose_topic(folder / "o.bag", "/odom", "alpha").trajectory)


def of_log(log: WirelessLog) -> Numbers:
    for m in log.measurements:
        yield [m.stamp_ns * 1e-9 / 100, m.range_m or 0.0, m.range_sigma_m or 0.0, *m.lever_arm_receiver]
        for p in m.paths:
            yield [p.azimuth, p.sigma, p.elevation or 0.0]
    yield [h.heading for h in log.headings]


def of_radio(name: str) -> Callable[[Path], Numbers]:
    def read(folder: Path) -> Numbers:
        (source,) = sources_of_words([str(folder / name)])
        return of_log(read_radio(source).log)

    return read


def of_wsr(folder: Path) -> Numbers:
    return [profile.azimuth for profile in read_wsr_profiles(folder / "w.json")]


def of_graph(folder: Path) -> Numbers:
    team = read_graphs([next(p for p in folder.iterdir() if p.is_file())])
    yield from (t.poses for t in team.odometry.values())
    yield from (c.measured.covariance for c in team.closures if c.measured is not None)


def of_dataset(folder: Path) -> Numbers:
    inputs = open_inputs([str(folder / "dataset.yaml")])
    yield from of_log(inputs.wireless)
    for robot in inputs.robots:
        if robot.odometry is not None:
            yield robot.odometry.poses


def of_config(folder: Path) -> Numbers:
    load_config(str(folder / "config.yaml"))
    return []


def of_words(folder: Path) -> Numbers:
    load_config(
        overrides=[line for line in (folder / "words").read_bytes().decode(errors="replace").split("\n") if line]
    )
    nested_words([f"a={(folder / 'words').read_bytes().decode(errors='replace')}"], "--set")
    return []


def of_kitti(folder: Path) -> Numbers:
    from wiclosure.pipeline.data.ground_truth import kitti_ground_truth

    truth = kitti_ground_truth(folder / "k", "alpha")
    return [*of_scans(folder / "k"), *(of_trajectory(truth) if truth is not None else [])]


def of_run(folder: Path) -> Numbers:
    components = [component["robots"] for component in read_metrics(folder)["components"]]
    merged, truth = read_trajectories(folder)
    evaluate_trajectories(merged, components, truth, read_evaluation_settings(folder))
    return [t.poses for t in merged.values()]


def of_report(folder: Path) -> Numbers:
    write_page(folder / "again.html", read_page(folder / "report.html"))
    return []


def of_candidates(folder: Path) -> Numbers:
    return [found.stamp_a_ns * 1e-9 / 100 for found in read_candidates(folder / "candidates.csv")]


def of_odometry_entry(folder: Path) -> Numbers:
    return [OdometryResult.load(folder / "odometry-entry").poses]


def of_descriptors(folder: Path) -> Numbers:
    return [Descriptors.load(folder / "entry").images]


def of_registrations(folder: Path) -> Numbers:
    return [r.measured.T_query_match for r in registration_store._load(folder / "entry").values() if r.measured]


def of_imu(folder: Path) -> Numbers:
    log = read_imu_table(folder / "imu.csv")
    return [getattr(log, name) for name in log.__dataclass_fields__ if name != "stamps_ns"]


def of_gnss(folder: Path) -> Numbers:
    log = read_gnss_table(folder / "gnss.csv")
    return [getattr(log, name) for name in log.__dataclass_fields__ if name != "stamps_ns"]


def a_file(folder: Path) -> Path:
    return next(p for p in folder.rglob("*") if p.is_file() and p.suffix in {".bag", ".mcap", ".db3"})


def in_a(folder: Path) -> Path:
    return folder / "a"


READERS: dict[str, Reader] = {
    "tum": Reader(True, by("a.tum", lambda p: write_tum(p, trajectory())), of_path("a.tum")),
    "euroc": Reader(True, text("a.csv", EUROC), of_path("a.csv")),
    "kitti poses": Reader(True, kitti_poses, lambda f: [read_kitti_poses(f / "a.txt").poses]),
    "kitti times, poses, calib": Reader(True, kitti, of_kitti),
    "wireless log": Reader(True, by("w.jsonl", lambda p: write_wireless_log(p, radio())), of_radio("w.jsonl")),
    "radio table": Reader(True, text("w.csv", CSV), of_radio("w.csv")),
    "wsr": Reader(True, text("w.json", wsr), of_wsr),
    "pyfg": Reader(True, text("w.pyfg", PYFG), of_radio("w.pyfg")),
    "g2o": Reader(True, graph("symbols"), of_graph, 1e9),
    "toro": Reader(True, graph("toro2"), of_graph, 1e9),
    "jrl": Reader(True, graph("robot log"), of_graph, 1e9),
    "dataset": Reader(True, dataset, of_dataset),
    "config": Reader(True, text("config.yaml", lambda: dump_config(Config(), comments=False)), of_config),
    "words": Reader(True, text("words", "\n".join(OVERRIDES)), of_words),
    "metadata": Reader(True, metadata, lambda f: list(of_scans(f / "a"))),
    "candidates": Reader(True, by("candidates.csv", candidates), of_candidates),
    "run folder": Reader(True, run_folder, of_run),
    "report": Reader(True, by("report.html", report), of_report),
    "imu table": Reader(True, text("imu.csv", IMU), of_imu),
    "gnss table": Reader(True, text("gnss.csv", GNSS), of_gnss),
    "pcd ascii": Reader(True, cloud("pcd", "ascii"), lambda f: list(of_scans(f))),
    "ply ascii": Reader(True, cloud("ply", "ascii"), lambda f: list(of_scans(f))),
    "pcd binary": Reader(False, cloud("pcd", "binary"), lambda f: list(of_scans(f))),
    "pcd compressed": Reader(False, cloud("pcd", "binary_compressed"), lambda f: list(of_scans(f))),
    "ply binary": Reader(False, cloud("ply", "binary_little_endian"), lambda f: list(of_scans(f))),
    "bin": Reader(False, cloud("bin", ""), lambda f: list(of_scans(f))),
    "ros1": Reader(False, by("a.bag", lambda p: write_ros1_bag(p, scans(), wireless=radio())), of_bag(a_file)),
    "ros1 bz2": Reader(False, packed_bag("BZ2"), of_bag(a_file)),
    "ros1 lz4": Reader(False, packed_bag("LZ4"), of_bag(a_file)),
    "mcap": Reader(False, ros2("mcap"), of_bag(a_file)),
    "mcap zstd": Reader(False, packed_mcap("zstd"), of_bag(a_file)),
    "mcap lz4": Reader(False, packed_mcap("lz4"), of_bag(a_file)),
    "sqlite3": Reader(False, ros2("sqlite3"), of_bag(in_a)),
    "odometry topic": Reader(False, typed_bag, of_odometry_topic),
    "wireless topics": Reader(False, ros2("mcap", wireless=radio()), lambda f: of_log(read_wireless_topics(f / "a"))),
    "g2o gz": Reader(False, graph("symbols", ".gz"), of_graph, 1e9),
    "g2o xz": Reader(False, graph("symbols", ".xz"), of_graph, 1e9),
    "jrl cbor": Reader(False, graph("robot log", ".cbor"), of_graph, 1e9),
    "odometry entry": Reader(False, by("odometry-entry", odometry_entry), of_odometry_entry),
    "descriptor entry": Reader(False, by("entry", descriptors), of_descriptors),
    "registration entry": Reader(False, by("entry", registration_entry), of_registrations),
}  # fmt: skip
