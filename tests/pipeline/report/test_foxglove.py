"""A finished run as ROS 2 messages, read back by rosbags."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from wiclosure import se3
from wiclosure.errors import InputError, OutputError
from wiclosure.formats.trajectories.tum import read_tum
from wiclosure.pipeline.report.foxglove import write_mcap
from wiclosure.pipeline.stages.run_folder import write_run
from wiclosure.pipeline.stages.run_result import RunResult


@pytest.fixture
def folder(lost_run: RunResult, tmp_path: Path) -> Path:
    """Of three robots, of which gamma is not connected."""
    (tmp_path / "run").mkdir()
    write_run(tmp_path / "run", lost_run)
    return tmp_path / "run"


def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Stamps and messages by topic."""
    found = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, stamp_ns, raw in reader.messages():
            found[connection.topic].append((stamp_ns, reader.deserialize(raw, connection.msgtype)))
    return found


def test_paths_transforms_and_map_are_those_of_the_run(folder: Path, lost_run: RunResult) -> None:
    write_mcap(folder, folder.parent / "run.mcap")
    found = read(folder.parent / "run.mcap")
    assert set(found) == {"/map", "/closures", "/tf", *(f"/{robot}/path" for robot in lost_run.merged)}
    transforms = defaultdict(list)
    for stamp_ns, message in found["/tf"]:
        (one,) = message.transforms
        assert one.header.stamp.sec * 10**9 + one.header.stamp.nanosec == stamp_ns
        transforms[one.child_frame_id].append((stamp_ns, one.header.frame_id, one.transform))
    for robot in lost_run.merged:
        path = read_tum(folder / f"{robot}.tum", robot)
        assert [stamp_ns for stamp_ns, _, _ in transforms[robot]] == path.stamps_ns.tolist()
        assert {frame for _, frame, _ in transforms[robot]} == {"map_gamma" if robot == "gamma" else "map"}
        _, _, last = transforms[robot][-1]
        position = np.array([last.translation.x, last.translation.y, last.translation.z])
        np.testing.assert_allclose(position, path.positions[-1])
        half_yaw = np.arctan2(last.rotation.z, last.rotation.w)
        assert np.cos(2 * half_yaw - se3.yaw(path.poses[-1])) == pytest.approx(1.0)
        ((_, drawn),) = found[f"/{robot}/path"]
        np.testing.assert_allclose([p.pose.position.x for p in drawn.poses], path.positions[:, 0])
    ((_, cloud),) = found["/map"]
    assert [field.name for field in cloud.fields] == ["x", "y", "z", "intensity"]
    assert cloud.width == len(lost_run.merged_map)


def test_closures_are_lines_between_their_keyframes(folder: Path, lost_run: RunResult) -> None:
    write_mcap(folder, folder.parent / "run.mcap")
    ((_, message),) = read(folder.parent / "run.mcap")["/closures"]
    lines = {marker.ns: [(p.x, p.y, p.z) for p in marker.points] for marker in message.markers}
    joined = lost_run.solution.graph.components[0]
    closures = [c for c in lost_run.solution.closures if c.query.robot in joined and c.match.robot in joined]
    accepted = [c for c in closures if c.rejected_at is None]
    assert accepted
    assert (len(lines["accepted"]), len(lines["rejected"])) == (2 * len(accepted), 2 * (len(closures) - len(accepted)))
    ends = [lost_run.merged[key.robot].positions[key.index] for c in accepted for key in (c.query, c.match)]
    np.testing.assert_allclose(lines["accepted"], ends, atol=1e-6)


def test_what_cannot_be_written_is_said_and_nothing_stays(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"ending \.mcap"):
        write_mcap(folder, tmp_path / "run.bag")
    (tmp_path / "there.mcap").write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        write_mcap(folder, tmp_path / "there.mcap")
    with pytest.raises(InputError):
        write_mcap(tmp_path, tmp_path / "other.mcap")
    (folder / "closures.csv").write_text("query_robot\nalpha\n")
    with pytest.raises(InputError, match=r"closures\.csv"):
        write_mcap(folder, tmp_path / "other.mcap")
    assert not (tmp_path / "other.mcap").exists()
