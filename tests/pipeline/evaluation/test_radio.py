"""What the radio was worth, and the robots' starts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.pipeline.evaluation.radio import radio_metrics, start_metrics
from wiclosure.types import AlignmentHypothesis, FilterResult, FrameAlignment, Trajectory


def test_sigmas_of_an_alignment() -> None:
    covariance = np.diag([1.0, 1.0, np.radians(2.0) ** 2, 0.25, 0.04, 4.0])
    best = AlignmentHypothesis(np.eye(4), 0.0, ((0, 0), (3, -1), (3, 1)))
    alignments = (
        FrameAlignment("a", "b", best, covariance, ambiguous=False, reason="20 links"),
        FrameAlignment("a", "c", None, None, ambiguous=True, reason="one link only"),
    )
    found = radio_metrics(FilterResult("wiclosure", (), 0, alignments))
    assert found["a-b"] == {
        "certain": True, "reason": "20 links", "yaw_sigma_deg": pytest.approx(2.0),
        "horizontal_sigma_m": pytest.approx(0.5), "height_sigma_m": pytest.approx(2.0),
        "measurements_explained": 2, "links_used": None,
    }  # fmt: skip
    assert (found["a-c"]["certain"], found["a-c"]["yaw_sigma_deg"]) == (False, None)


def test_starts_of_connected_robots() -> None:
    T_a_b = se3.from_rotation_translation(Rotation.from_euler("Z", 40, degrees=True).as_matrix(), np.array([3.0, 4, 5]))
    T_world_a = se3.from_rotation_translation(
        Rotation.from_euler("Z", 70, degrees=True).as_matrix(), np.array([9.0, 9, 9])
    )
    stamps_ns = np.array([0], np.int64)
    merged = {
        "a": Trajectory("a", stamps_ns, T_world_a[None]),
        "b": Trajectory("b", stamps_ns, (T_world_a @ T_a_b)[None]),
        "c": Trajectory("c", stamps_ns, np.eye(4)[None]),
    }
    starts = start_metrics(merged, [["a", "b"], ["c"]])
    assert list(starts) == ["a-b"]
    assert (starts["a-b"]["x_m"], starts["a-b"]["z_m"], starts["a-b"]["yaw_deg"]) == pytest.approx((3.0, 5.0, 40.0))
