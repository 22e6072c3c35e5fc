"""The front end's goals, each against its peer in the same run on the same scans, with peak memory.

    python benchmarks/front_end.py [--rows odometry,jobs,ahead,descriptor,pairs,registration,indoor,worlds] [--seeds 1]

Recorded scans come from WICLOSURE_DATA; the worlds of the last row are simulated with aliasing 0.8, and their odometry
is kept in the cache, so that a second run is quicker.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import small_gicp
from kiss_icp.config import KISSConfig
from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
from kiss_icp.kiss_icp import KissICP
from odometry import PackedScans, peak_resident_mb

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.frontends.config import (
    IntraRobotLoopSettings,
    KeyframeSettings,
    MatchingSettings,
    OdometrySettings,
    ScanContextSettings,
)
from wiclosure.frontends.front_end import FrontEndResult, OdometryRun, describe_all
from wiclosure.frontends.odometry.kiss_odometry import KissOdometry
from wiclosure.frontends.place_recognition.intra_robot_loops import intra_robot_loops
from wiclosure.frontends.place_recognition.matching import match
from wiclosure.frontends.place_recognition.scan_context import ColumnSpectra, compare_descriptors, describe
from wiclosure.frontends.registration.registration import Registration
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.pipeline.config import Config, resolve
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.mutual_check.radio_check import radio_checked
from wiclosure.pipeline.runtime.cache import StageCache, default_cache_folder
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.odometry import front_ends
from wiclosure.pipeline.stages.run import candidate_filter
from wiclosure.types import (
    CandidatePairs,
    Closure,
    FilterResult,
    Float32Array,
    FloatArray,
    IntArray,
    KeyframeId,
    Prediction,
    PredictionKind,
    Trajectory,
)

DATA = Path(os.environ.get("WICLOSURE_DATA", "../shared/data"))
STREET = f"scenario:kitti08,robots=1,poses={DATA / 'kitti_odometry' / 'gt' / '08.txt'}"
WRONG_M, WRONG_DEG, NEAR_M = 2.0, 5.0, 10.0


@contextmanager
def row(title: str, goal: str) -> Iterator[None]:
    """Prints the row's title, lets it print its figures, and adds its peak of resident memory."""
    print(f"{title} (goal: {goal})", flush=True)
    Path("/proc/self/clear_refs").write_text("5")
    yield
    print(f"  peak memory {peak_resident_mb():.0f} MB", flush=True)


def seconds_of(work: Callable[[], object], repeat: int = 1) -> float:
    """The quickest of some runs."""
    best = float("inf")
    for _ in range(repeat):
        began = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - began)
    return best


def drive() -> PackedScans:
    return PackedScans(DATA / "kitti_raw_0926_0005" / "scans.npz")


def odometry() -> None:
    scans = drive()
    voxel_m = voxel_size_m(scans.scan(0).points)
    # Both on one core: KISS-ICP settles its threads once in a process.
    one = RegistrationConfig(max_num_threads=1)
    kiss = KissICP(KISSConfig(data=DataConfig(), mapping=MappingConfig(voxel_size=voxel_m), registration=one))
    ours = OdometryRun(OdometrySettings(), [KeyframeSettings()], "alpha")
    bare_s = ours_s = 0.0
    with row("odometry, keyframes and descriptors against a bare KISS-ICP loop", "<= 1.10 x"):
        for index in range(len(scans)):
            scan = scans.scan(index)
            ours_s += seconds_of(partial(ours.process, scan))
            bare_s += seconds_of(partial(kiss.register_frame, scan.points, np.zeros(0)))
        ours_s += seconds_of(lambda: describe_all(ours.results()[0].clouds, ScanContextSettings()))
        print(f"  {len(scans)} scans: bare {bare_s:.2f} s, ours {ours_s:.2f} s, {ours_s / bare_s:.2f} x")


def front_ends_of(data: list[str], num_threads: int, processes: int) -> tuple[float, bytes]:
    """Seconds, and all poses; in a process of its own, as KISS-ICP settles its threads once in a process."""
    config = Config.model_validate({"odometry": {"num_threads": num_threads}})
    robots = open_inputs(data, limit=200).robots
    began = time.perf_counter()
    found, _ = front_ends(robots, config, cache=StageCache(None), jobs=processes, progress=NoProgress())
    return time.perf_counter() - began, b"".join(front.odometry.poses.tobytes() for front in found.values())


def jobs() -> None:
    scans = drive()
    arms = {"-j 1, KISS-ICP on all cores": (0, 1), "-j 1": (1, 1), "-j 2": (1, 2)}
    seconds, poses = {}, {}
    with tempfile.TemporaryDirectory() as folder, row("two robots, -j 2 against -j 1", ">= 1.5 x faster, same results"):
        write_kitti_folder(Path(folder) / "drive", (scans.scan(k) for k in range(len(scans))))
        data = [f"{name}={Path(folder) / 'drive'}" for name in ("alpha", "beta")]
        for label, (threads, processes) in arms.items():
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as fresh:
                seconds[label], poses[label] = fresh.submit(front_ends_of, data, threads, processes).result()
            print(f"  {label:28} {seconds[label]:6.2f} s", flush=True)
    on_all_cores, one_thread, two_processes = seconds.values()
    print(
        f"  -j 2 is {one_thread / two_processes:.2f} x as fast as -j 1, {on_all_cores / two_processes:.2f} x as fast as"
        f" -j 1 on all cores; bit for bit the same as -j 1: {poses['-j 1'] == poses['-j 2']}"
    )


def ahead() -> None:
    data = [STREET]
    seconds, poses = {}, {}
    with row("one robot whose scans are costly to read: rays cast by a process of their own", "same results"):
        for processes in (1, 2):
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as fresh:
                seconds[processes], poses[processes] = fresh.submit(front_ends_of, data, 1, processes).result()
        print(
            f"  200 scans: -j 1 {seconds[1]:.2f} s, -j 2 {seconds[2]:.2f} s, {seconds[1] / seconds[2]:.2f} x as fast;"
            f" bit for bit the same: {poses[1] == poses[2]}"
        )


def descriptor() -> None:
    points = drive().scan(0).points
    settings = ScanContextSettings()

    def by_definition() -> FloatArray:
        """Bins by arctan2 and a sort: what one writes first."""
        image = np.zeros((settings.rings, settings.sectors))
        distance = np.hypot(points[:, 0], points[:, 1])
        ring = (distance / settings.max_range_m * settings.rings).astype(int)
        turns = np.mod(np.arctan2(points[:, 1], points[:, 0]) / (2 * np.pi), 1.0)
        sector = (turns * settings.sectors).astype(int) % settings.sectors
        height = points[:, 2] + settings.height_offset_m
        used = (distance < settings.max_range_m) & (height > 0)
        np.maximum.at(image, (ring[used], sector[used]), height[used])
        return image

    with row(f"descriptor of a scan of {len(points)} points", "<= 3 ms"):
        ours_s = seconds_of(lambda: describe(points, settings), 50)
        peer_s = seconds_of(by_definition, 10)
        print(f"  ours {ours_s * 1e3:.2f} ms, by the definition in float64 {peer_s * 1e3:.2f} ms")


def pairs() -> None:
    rng = np.random.default_rng(0)
    count = 1050
    first, second = (rng.random((count, 20, 60)).astype(np.float32) for _ in range(2))
    contexts = (first, second)
    for images in contexts:
        images[:, :, :5] = 0.0  # some columns are empty, as where the sensor does not look
    a, b = np.divmod(np.arange(count**2), count)
    spectra = (ColumnSpectra.of(first), ColumnSpectra.of(second))

    def by_definition(rows: IntArray) -> FloatArray:
        """Every shift by rolling columns (paper, eqs. 6 and 7)."""
        unit = [c / np.maximum(np.linalg.norm(c, axis=1, keepdims=True), 1e-9) for c in contexts]
        shared = np.array([(np.roll(unit[0][0].any(axis=0), -s) & unit[1][0].any(axis=0)).sum() for s in range(60)])
        cosines = [np.einsum("mrs,mrs->m", np.roll(unit[0][a[rows]], -s, axis=2), unit[1][b[rows]]) for s in range(60)]
        return np.asarray(1.0 - np.max(np.array(cosines) / np.maximum(shared, 15)[:, None], axis=0))

    with row(f"{len(a):,} pairs at all 60 shifts", "<= 1.0 s, <= 1 GB"):
        began = time.process_time()
        ours_s = seconds_of(lambda: compare_descriptors(*spectra, a, b), 3)
        processor_s = (time.process_time() - began) / 3
        some = rng.permutation(len(a))[:500]
        peer_s = seconds_of(lambda: by_definition(some)) * len(a) / len(some)
        gap = np.abs(by_definition(some) - compare_descriptors(*spectra, a[some], b[some])[0]).max()
        print(
            f"  ours {ours_s:.2f} s ({processor_s:.2f} s of processor time), rolling columns {peer_s:.0f} s (from"
            f" {len(some)} pairs), difference {gap:.0e}"
        )
        for width in (10, 30, 100):
            near = np.flatnonzero(np.abs(a - b) < width)
            near_s = seconds_of(partial(compare_descriptors, *spectra, a[near], b[near]), 3)
            print(
                f"  {len(near):7,} pairs as a filter keeps them: {near_s:.3f} s, {near_s / len(near) * 1e6:.1f} us each"
            )
        whole = CandidatePairs.without_prediction("alpha", "beta", a, b)
        for neighbours in (50, None):
            settings = MatchingSettings(ring_key_neighbours=neighbours)
            matching_s = seconds_of(partial(match, whole, *contexts, settings))
            kind = "all" if neighbours is None else f"the {neighbours} nearest ring keys"
            print(f"  matching over {kind}: {matching_s:.2f} s")


def perturbed(T: FloatArray, rng: np.random.Generator) -> Prediction:
    """A prediction of `T`: 1 m and 3 degrees off, and saying so."""
    sigma = np.array([0.01, 0.01, np.radians(3.0), 0.7, 0.7, 0.2])
    return Prediction(T @ se3.exp(rng.normal(0, sigma)), np.diag(np.square(sigma)), PredictionKind.POSE)


def errors_of(T_true: FloatArray, T: FloatArray) -> tuple[float, float]:
    gap = se3.between(T_true, T)
    return float(np.linalg.norm(gap[:3, 3])), float(np.degrees(se3.rotation_angle(gap)))


@dataclass(frozen=True)
class Seen:
    """A scan as it is registered: thinned and whole, both deskewed, and where it was taken."""

    thinned: Float32Array
    whole: FloatArray
    T_world_body: FloatArray


def recorded_street() -> list[Seen]:
    """The recorded drive; the truth are KISS-ICP's poses at its own settings, which err by some centimetres too."""
    scans, odometry = drive(), KissOdometry(OdometrySettings(convergence=1e-4, points_per_voxel=20))
    seen = []
    for k in range(0, 120, 2):
        _, pose, points = odometry.register(scans.scan(k))
        seen.append(Seen(odometry.thinned.astype(np.float32), points, pose))
    return seen


def simulated_street() -> list[Seen]:
    """The start of `kitti08`; the truth is the world's."""
    (robot,) = open_inputs([STREET], limit=120).robots
    assert robot.ground_truth is not None
    odometry, seen = KissOdometry(OdometrySettings()), []
    for k, scan in enumerate(robot.scans):
        stamp_ns, _, points = odometry.register(scan)
        if k % 2 == 0:
            pose = robot.ground_truth.at(np.array([stamp_ns]))[0]
            seen.append(Seen(odometry.thinned.astype(np.float32), points, pose))
    return seen


def registration() -> None:
    with row("registration of HDL-64 keyframes against small_gicp.align on whole scans", "<= 0.5 x, no worse"):
        register_both("recorded, truth of KISS-ICP", recorded_street())
        register_both("simulated, exact truth", simulated_street())


def register_both(label: str, seen: list[Seen]) -> None:
    rng = np.random.default_rng(0)
    chosen = [(i, i + step) for step in (6, 10, 14) for i in range(0, 45, 3)]
    registration, ours, peer = Registration(), [], []
    ours_s = peer_s = 0.0
    apart_m = [np.linalg.norm(seen[i].T_world_body[:3, 3] - seen[j].T_world_body[:3, 3]) for i, j in chosen]
    print(f"  {label}: {len(chosen)} pairs {min(apart_m):.1f}-{max(apart_m):.1f} m apart")
    for i, j in chosen:
        T_true = se3.between(seen[i].T_world_body, seen[j].T_world_body)
        a, b = (KeyframeId(name, k) for name, k in (("alpha", i), ("beta", j)))
        clouds = seen[i].thinned, seen[j].thinned
        registration.verify(Closure(a, b, perturbed(T_true, rng)), *clouds)  # prepares
        prediction = perturbed(T_true, rng)
        began = time.perf_counter()
        found = registration.verify(Closure(a, b, prediction), *clouds)
        ours_s += time.perf_counter() - began
        ours.append((*errors_of(T_true, found.best_T_query_match), found.live))
        began = time.perf_counter()
        aligned = small_gicp.align(seen[i].whole, seen[j].whole, prediction.T_query_match)
        peer_s += time.perf_counter() - began
        peer.append(errors_of(T_true, aligned.T_target_source))
    for name, seconds, found_errors in (("ours", ours_s, ours), ("small_gicp.align", peer_s, peer)):
        errors = np.array([error[0] for error in found_errors])
        print(
            f"    {name:17} {seconds / len(chosen) * 1e3:6.1f} ms a pair; error median {np.median(errors):.3f} m,"
            f" mean {errors.mean():.3f} m, largest {errors.max():.3f} m"
        )
    nearer = sum(mine[0] < its[0] for mine, its in zip(ours, peer, strict=True))
    print(
        f"    {ours_s / peer_s:.2f} x its time; ours is nearer to the truth in {nearer} of {len(ours)},"
        f" {sum(o[2] for o in ours)} verified"
    )


@dataclass
class Tally:
    """What became of closures; `near_m`: how far apart scans can be registered."""

    near_m: float = NEAR_M
    proposed: int = 0
    verified: int = 0
    wrong: int = 0
    near: int = 0
    near_verified: int = 0
    nees: float = 0.0

    def count(self, closure: Closure, T_true: FloatArray) -> bool:
        """Counts one; whether it is verified and right."""
        metres, degrees = errors_of(T_true, closure.best_T_query_match)
        wrong = metres > WRONG_M or degrees > WRONG_DEG
        passed = closure.live
        near = float(np.linalg.norm(T_true[:3, 3])) <= self.near_m
        self.proposed += 1
        self.verified += passed
        self.wrong += passed and wrong
        self.near += near
        self.near_verified += near and passed and not wrong
        if passed and not wrong and closure.measured is not None:
            error = se3.log(se3.between(T_true, closure.measured.T_query_match))
            self.nees += float(error @ np.linalg.solve(closure.measured.covariance, error)) / 6
        return passed and not wrong

    def __str__(self) -> str:
        right = max(self.verified - self.wrong, 1)
        share = self.near_verified / max(self.near, 1)
        return (
            f"{self.verified} of {self.proposed} verified, {self.wrong} of them wrong; of {self.near} within"
            f" {self.near_m:g} m {self.near_verified} right ({share:.0%}); NEES {self.nees / right:.2f}"
        )


def indoor() -> None:
    recording = DATA / "indoor_loop" / "scans.npz"
    scans = PackedScans(recording)
    with np.load(recording) as pack:
        truth = Trajectory("alpha", np.rint(pack["stamps"] * 1e9).astype(np.int64), pack["poses"])
    run = OdometryRun(OdometrySettings(), [KeyframeSettings(distance_m=0.5)], "alpha", recorded=truth)
    for k in range(len(scans)):
        run.process(scans.scan(k))
    (followed,) = run.results()
    front = FrontEndResult.of("alpha", DriftModel(), followed, describe_all(followed.clouds, ScanContextSettings()))
    settings = IntraRobotLoopSettings(min_travel_m=15.0)
    travelled = front.keyframes.distance[None] - front.keyframes.distance[:, None]
    apart = np.linalg.norm(front.keyframes.positions[:, None] - front.keyframes.positions[None], axis=2)
    true = (travelled >= settings.min_travel_m) & (apart <= NEAR_M)
    places = set(np.flatnonzero(true.any(axis=0) | true.any(axis=1)).tolist())
    a, b = np.nonzero(travelled >= settings.min_travel_m)
    arms = {
        "along recorded odometry": intra_robot_loops(front.keyframes, settings),
        "by looks alone": CandidatePairs.without_prediction("alpha", "alpha", a, b),
    }
    every_place = MatchingSettings(suppression_where_located=0)  # counted is every keyframe
    with row("intra-robot loops on indoor_loop, places within 10 m", ">= 90 % found, none false"):
        for label, candidates in arms.items():
            registration, tally, found = Registration(), Tally(), set()
            for closure in match(candidates, front.descriptors, front.descriptors, every_place).closures:
                i, j = closure.query.index, closure.match.index
                registered = registration.verify(closure, front.clouds[i], front.clouds[j])
                T_true = se3.between(front.keyframes.poses[i], front.keyframes.poses[j])
                if tally.count(registered, T_true):
                    found |= {i, j}
            print(f"  {label}: {len(found & places)} of {len(places)} places; {tally}")


def worlds(seeds: Iterable[int]) -> None:
    for name, site in (("shell-space", "shell-space"), ("city", None)):
        for seed in seeds:
            with row(f"{name}, aliasing 0.8, seed {seed}, filter on", "no wrong one at >= 80 % kept; NEES 0.5 to 2"):
                world(open_inputs([f"scenario:{name},aliasing=0.8,seed={seed}"]), resolve(site, None))


def world(inputs: Inputs, config: Config, sample: int = 100) -> None:
    """What matching proposes, and a sample of what the filter keeps, of pairs that can be registered and beyond."""
    near_m = config.evaluation.registrable_radius_m
    cache = StageCache(default_cache_folder())
    fronts, _ = front_ends(inputs.robots, config, cache=cache, jobs=2, progress=NoProgress())
    keyframes = {robot: front.keyframes for robot, front in fronts.items()}
    filtered = candidate_filter("wiclosure", inputs, config).candidates(keyframes, inputs.wireless)
    kept = filtered.pairs[0]
    ends = [inputs.ground_truth[robot].at(keyframes[robot].stamps_ns) for robot in (kept.robot_a, kept.robot_b)]
    apart = np.linalg.norm(ends[0][:, None, :3, 3] - ends[1][None, :, :3, 3], axis=2)
    near = apart[kept.index_a, kept.index_b] <= near_m
    print(f"  filter keeps {near.sum()} of {(apart <= near_m).sum()} pairs within {near_m:g} m, {len(kept)} in all")
    if kept.predicts is None:
        print("  its alignment is ambiguous: it predicts nothing")
    descriptors_a, descriptors_b = (fronts[r].descriptors for r in (kept.robot_a, kept.robot_b))
    best = match(kept, descriptors_a, descriptors_b, config.matching).closures
    print(f"  proposed: {verified(best, filtered, fronts, ends, near_m)}")
    rng = np.random.default_rng(0)
    exhaustive = MatchingSettings(
        ring_key_neighbours=None,
        candidates_per_keyframe=10**6,
        max_distance=1.0,
        max_distance_with_prediction=1.0,
        suppression_where_located=0,
    )
    for label, chosen in ((f"within {near_m:g} m", near), ("beyond", ~near)):
        rows = np.sort(rng.permutation(np.flatnonzero(chosen))[:sample])
        some = CandidatePairs(
            kept.robot_a,
            kept.robot_b,
            kept.index_a[rows],
            kept.index_b[rows],
            kept.overlap_probability[rows],
            kept.mahalanobis[rows],
            kept.predictor,
        )
        closures = match(some, descriptors_a, descriptors_b, exhaustive).closures
        print(f"  {label}, any looks: {verified(closures, filtered, fronts, ends, near_m)}")


def verified(
    closures: Iterable[Closure],
    filtered: FilterResult,
    fronts: dict[str, FrontEndResult],
    ends: list[FloatArray],
    near_m: float,
) -> Tally:
    """What registration and the radio check make of closures between two robots."""
    registration, tally = Registration(), Tally(near_m)
    measured = []
    for closure in closures:
        clouds: list[Float32Array] = [fronts[k.robot].clouds[k.index] for k in (closure.query, closure.match)]
        measured.append(registration.verify(closure, clouds[0], clouds[1]))
    for registered in radio_checked(measured, filtered.checks):
        tally.count(registered, se3.between(ends[0][registered.query.index], ends[1][registered.match.index]))
    return tally


ROWS: dict[str, Callable[[], None]] = {
    "odometry": odometry,
    "jobs": jobs,
    "ahead": ahead,
    "descriptor": descriptor,
    "pairs": pairs,
    "registration": registration,
    "indoor": indoor,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", default=",".join([*ROWS, "worlds"]), help="which, separated by commas")
    parser.add_argument("--seeds", type=int, default=1, help="of the simulated worlds")
    arguments = parser.parse_args()
    for name in arguments.rows.split(","):
        if name == "worlds":
            worlds(range(arguments.seeds))
        else:
            ROWS[name]()


if __name__ == "__main__":
    main()
