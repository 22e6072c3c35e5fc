from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
from rerun.chunk import RrdReader

from wiclosure import se3
from wiclosure.pipeline.report.viewer import columns


def test_ellipsoids_have_the_standard_deviations_of_the_covariance(tmp_path: Path) -> None:
    recording = rr.RecordingStream("test")
    recording.set_sinks(rr.FileSink(tmp_path / "a.rrd"))
    covariance = np.zeros((1, 6, 6))
    covariance[0, 3:, 3:] = np.diag([9.0, 1.0, 4.0])
    T_world_body = se3.from_yaw(np.pi / 2, np.array([1.0, 2.0, 3.0]))[None]
    columns.ellipsoids(recording, "e", np.array([10**9]), T_world_body, covariance)
    recording.flush(timeout_sec=10)
    recording.disconnect()
    (batch,) = [c.to_record_batch() for c in RrdReader(tmp_path / "a.rrd").stream() if c.entity_path == "/e"]
    column = {
        name.rpartition(":")[2]: batch.column(name).to_pylist()[0][0] for name in batch.schema.names[1:] if ":" in name
    }
    np.testing.assert_allclose(sorted(column["half_sizes"]), [1.0, 2.0, 3.0], atol=1e-5)
    np.testing.assert_allclose(column["centers"], [1.0, 2.0, 3.0], atol=1e-5)
    from scipy.spatial.transform import Rotation

    axes = Rotation.from_quat(column["quaternions"]).as_matrix()
    spread = axes @ np.diag(np.square(column["half_sizes"])) @ axes.T
    np.testing.assert_allclose(spread, np.diag([1.0, 9.0, 4.0]), atol=1e-4)  # x of the body is y of the world


def test_rows_of_one_stamp_are_gathered() -> None:
    order, unique, counts = columns.by_stamp(np.array([5, 3, 5, 4]))
    assert order.tolist() == [1, 3, 0, 2]
    assert unique.tolist() == [3, 4, 5]
    assert counts.tolist() == [1, 1, 2]
