"""Writes a simulated scenario as a user would bring it: recordings, wireless log, ground truth, `dataset.yaml`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from scipy.spatial.transform import Rotation

from wiclosure.errors import ConfigError
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.data.dataset_file import DATASET_FILE, WIRELESS_FILE, write_dataset
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros1_bag, write_ros2_bag
from wiclosure.pipeline.data.navigation.writer import write_gnss_table, write_imu_table
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.simulation.scenario import Scenario
from wiclosure.types import Scan, WirelessLog
from wiclosure.workers import ThisProcess, Workers, require_wanted, tell

Recorder: TypeAlias = Callable[[Path, Iterable[Scan], WirelessLog], Path]


def _ros1(stem: Path, scans: Iterable[Scan], wireless: WirelessLog) -> Path:
    write_ros1_bag(stem.with_suffix(".bag"), scans, wireless=wireless)
    return stem.with_suffix(".bag")


def _ros2_mcap(stem: Path, scans: Iterable[Scan], wireless: WirelessLog) -> Path:
    write_ros2_bag(stem, scans, storage="mcap", wireless=wireless)
    return stem


def _ros2_sqlite3(stem: Path, scans: Iterable[Scan], wireless: WirelessLog) -> Path:
    write_ros2_bag(stem, scans, storage="sqlite3", wireless=wireless)
    return stem


def _kitti(stem: Path, scans: Iterable[Scan], wireless: WirelessLog) -> Path:
    write_kitti_folder(stem, scans)
    return stem


RECORDERS: dict[str, Recorder] = {
    "ros1": _ros1,
    "ros2-mcap": _ros2_mcap,
    "ros2-sqlite3": _ros2_sqlite3,
    "kitti": _kitti,
}


def require_format(name: str) -> None:
    """Fails where there is no recording format of that name.

    Raises:
        ConfigError: names those that there are.
    """
    if name not in RECORDERS:
        raise ConfigError(f"unknown recording format {name!r}; choose one of {', '.join(RECORDERS)}")


def write_scenario(
    scenario: Scenario,
    folder: Path,
    formats: Mapping[str, str],
    *,
    progress: Progress,
    workers: Workers | None = None,
) -> Path:
    """Writes everything into an existing folder; the wireless records are in the log, and in bags as topics too.

    Args:
        scenario: the world.
        folder: where the files go.
        formats: name of the recording format by robot; see `RECORDERS`.
        progress: shows how far it is.
        workers: who casts rays, each for one robot at a time; those of a cluster must see the folder under this path.

    Returns:
        The `dataset.yaml`.

    Raises:
        ConfigError: an unknown format, or a cluster that does not share the folder.
        OutputError: a file cannot be written.
    """
    for name in formats.values():
        require_format(name)
    wireless = scenario.wireless()
    recordings = _recordings(scenario, folder, formats, wireless, progress, workers or ThisProcess())
    robots = {}
    for robot, recording in recordings.items():
        ground_truth = folder / f"{robot}_gt.tum"
        write_tum(ground_truth, scenario.ground_truth(robot))
        as_simulated = {"elevation_correction_deg": 0.0} if formats[robot] == "kitti" else {}
        robots[robot] = replace(
            _navigation(scenario, robot, folder, RobotRecording(recording)),
            ground_truth=ground_truth,
            odometry_settings=as_simulated,
        )
    write_wireless_log(folder / WIRELESS_FILE, wireless)
    write_dataset(folder / DATASET_FILE, robots, [RadioSource(path=folder / WIRELESS_FILE)])
    return folder / DATASET_FILE


@dataclass(frozen=True, eq=False)
class _Recording:
    """One robot's recording: where its file goes, and all that it depends on."""

    scenario: Scenario
    robot: str
    stem: Path
    format: str
    wireless: WirelessLog

    def __str__(self) -> str:
        return f"simulation of {self.robot}"

    def scans(self) -> Iterator[Scan]:
        for done, scan in enumerate(self.scenario.scan_source(self.robot), start=1):
            require_wanted()
            yield scan
            tell(self.robot, done)


def _recorded(work: _Recording) -> Path:
    return RECORDERS[work.format](work.stem, work.scans(), work.wireless)


def _recordings(
    scenario: Scenario,
    folder: Path,
    formats: Mapping[str, str],
    wireless: WirelessLog,
    progress: Progress,
    workers: Workers,
) -> dict[str, Path]:
    """Casts the rays of all robots, and writes them; the file or folder of each robot."""
    work = [_Recording(scenario, robot, folder / robot, formats[robot], wireless) for robot in scenario.robots]
    totals = {robot: len(scenario.scan_source(robot)) for robot in scenario.robots}
    with (
        progress.together(totals, "simulating") as counted,
        closing(workers.each(_recorded, work, told=counted)) as done,
    ):
        written = dict(done)
    for path in written.values():
        if not path.exists():
            raise ConfigError(f"a worker wrote {path}, which is not here: the workers must share the folder of --out")
    return {one.robot: written[number] for number, one in enumerate(work)}


def _navigation(scenario: Scenario, robot: str, folder: Path, recording: RobotRecording) -> RobotRecording:
    """With tables of what its IMU and its satellite receiver gave, where it has them."""
    imu, gnss = scenario.imu_log(robot), scenario.gnss_log(robot)
    if imu is not None and scenario.imu is not None:
        write_imu_table(folder / f"{robot}_imu.csv", imu)
        T = scenario.imu.T_lidar_imu()
        pose = (*T[:3, 3].tolist(), *Rotation.from_matrix(T[:3, :3]).as_quat().tolist())
        recording = replace(recording, imu=folder / f"{robot}_imu.csv", imu_pose=pose)
    if gnss is not None and scenario.gnss is not None:
        write_gnss_table(folder / f"{robot}_gnss.csv", gnss)
        antenna = tuple(scenario.gnss.antenna_lidar().tolist())
        recording = replace(recording, gnss=folder / f"{robot}_gnss.csv", gnss_antenna=antenna)
    return recording
