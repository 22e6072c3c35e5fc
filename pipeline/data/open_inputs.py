"""Opens what the user names, data set or scenario, and checks it before any work is done."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from wiclosure.errors import ConfigError, InputError
from wiclosure.pipeline.data.dataset import Dataset, load_dataset
from wiclosure.pipeline.data.inputs import Inputs, RobotInput
from wiclosure.pipeline.data.navigation.reader import read_gnss, read_imu
from wiclosure.pipeline.data.odometry_reader import near_origin
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.radio.words import sources_of_words
from wiclosure.pipeline.runtime.cache import file_identity
from wiclosure.pipeline.sources.kitti import ELEVATION_CORRECTION_DEG, is_kitti_folder
from wiclosure.types import FloatArray

logger = logging.getLogger(__name__)


def open_inputs(
    data: Sequence[str],
    *,
    topic: str | None = None,
    wireless: Sequence[str] = (),
    limit: int | None = None,
    salvage: bool = False,
) -> Inputs:
    """Opens everything that the user names, so that what is wrong shows before the long work starts.

    Args:
        data: one `dataset.yaml`, recordings as `alpha=path`, or one `scenario:NAME` (see `scenario_source`).
        topic: PointCloud2 topic of all bags, whatever the data set states.
        wireless: words that name radio logs besides those of the data set (see `sources_of_words`).
        limit: read at most so many scans per robot.
        salvage: use what can be read of damaged bags.

    Raises:
        InputError: something is missing, malformed, or does not belong together.
        ConfigError: a scenario with impossible settings, or beside other data.
    """
    if any(word.startswith("scenario:") for word in data):
        if len(data) > 1 or topic or wireless or salvage:
            raise ConfigError(
                f"{' '.join(data)}: a scenario stands alone, with its own radio; leave other data, --topic, --wireless"
                " and --salvage out"
            )
        # Imported here: it needs scipy's splines, which recordings do not.
        from wiclosure.pipeline.data.scenarios.scenario_source import read_scenario_word, scenario_inputs

        return scenario_inputs(*read_scenario_word(data[0]), limit=limit)
    dataset = load_dataset(data, topic=topic, wireless=sources_of_words(wireless))
    robots = tuple(_robot_input(dataset, robot, limit=limit, salvage=salvage) for robot in dataset.robots)
    return Inputs(robots, dataset.wireless_log(salvage=salvage), limit)


def _robot_input(dataset: Dataset, robot: str, *, limit: int | None, salvage: bool) -> RobotInput:
    recording = dataset.robots[robot]
    scans = dataset.scans(robot, limit=limit, salvage=salvage)
    odometry, origin_m = dataset.odometry(robot, salvage=salvage), (0.0, 0.0, 0.0)
    remarks = []
    if odometry is not None:
        odometry, origin_m = near_origin(odometry)
        if any(origin_m):
            remarks.append(
                f"{robot}: its odometry starts at {_text(odometry.positions[0] + origin_m)} m; it is used relative to"
                f" {_text(np.array(origin_m))} m, as are the world and the map where it is the first robot's"
            )
    imu, of_imu = read_imu(robot, recording, salvage=salvage)
    gnss, of_gnss = read_gnss(robot, recording, salvage=salvage)
    remarks += [*of_imu, *of_gnss]
    truth = None
    try:
        truth = dataset.ground_truth(robot, salvage=salvage)
    except InputError as error:  # ground truth only evaluates a run, and does not stop it
        remarks.append(f"{robot}: ground truth is left out: {error}")
        logger.warning("%s", remarks[-1])
    return RobotInput(
        robot=robot,
        scans=scans,
        identity=_identity(recording, limit, salvage),
        ground_truth=truth,
        salvaged=salvage,
        odometry=odometry,
        odometry_origin_m=origin_m,
        elevation_correction_deg=ELEVATION_CORRECTION_DEG if is_kitti_folder(recording.scans) else 0.0,
        odometry_settings=recording.odometry_settings,
        remarks=tuple(remarks),
        imu=imu,
        gnss=gnss,
    )


def _identity(recording: RobotRecording, limit: int | None, salvage: bool) -> list[object]:
    """All that the scans and the odometry brought along depend on."""
    odometry = None if recording.odometry is None else file_identity(recording.odometry)
    return [
        file_identity(recording.scans), recording.topic, recording.layout, recording.scan_unit,
        recording.time_offset_ns, limit, salvage, odometry, recording.odometry_topic, recording.lidar_pose,
    ]  # fmt: skip


def _text(position: FloatArray) -> str:
    return f"({', '.join(f'{number:.0f}' for number in position)})"
