from __future__ import annotations

import sys

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import ConfigError
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.registration.global_registration import global_starts
from wiclosure.frontends.registration.prepared_cloud import PreparedCloud
from wiclosure.types import FloatArray


def cloud(T_body_world: FloatArray) -> PreparedCloud:
    """A yard of boxes of different sizes, seen from a pose."""
    rng = np.random.default_rng(7)
    points = []
    for _ in range(14):
        size = rng.uniform(1.0, 6.0, 3)
        box = rng.uniform(-0.5, 0.5, (700, 3))
        face = rng.integers(0, 3, 700)
        box[np.arange(700), face] = rng.choice([-0.5, 0.5], 700)
        points.append(box * size + [*rng.uniform(-25, 25, 2), size[2] / 2 - 1.5])
    world = np.concatenate(points)
    return PreparedCloud.of(se3.transform(T_body_world, world).astype(np.float32), (2.0, 1.0, 0.5), 1)


def test_scan_contexts_yaw_comes_first_and_the_others_go_around_the_circle() -> None:
    here = cloud(np.eye(4))
    starts = global_starts(RegistrationSettings(yaw_hypotheses=4))(here, here, 0.3)
    np.testing.assert_allclose(np.sort(se3.yaw(starts)), np.sort(0.3 + np.array([0.0, 0.5, -0.5, -1.0]) * np.pi))
    assert se3.yaw(starts[0]) == pytest.approx(0.3)
    np.testing.assert_array_equal(starts[:, :3, 3], 0.0)


def test_kiss_matcher_finds_the_pose_by_features_and_keeps_the_others_behind_it() -> None:
    pytest.importorskip("kiss_matcher")
    T_query_match = se3.from_yaw(2.0, np.array([4.0, -3.0, 0.0]))
    query, match = cloud(np.eye(4)), cloud(se3.inverse(T_query_match))
    settings = RegistrationSettings(global_start="kiss-matcher", yaw_hypotheses=4)
    starts = global_starts(settings)(query, match, None)
    assert len(starts) == 5
    gap = se3.between(T_query_match, starts[0])
    assert np.linalg.norm(gap[:3, 3]) < 1.0
    assert se3.rotation_angle(gap) < 0.1
    np.testing.assert_allclose(starts[0, :3, :3] @ starts[0, :3, :3].T, np.eye(3), atol=1e-12)


def test_without_features_kiss_matcher_adds_nothing() -> None:
    pytest.importorskip("kiss_matcher")
    noise = np.random.default_rng(0).uniform(-30, 30, (2, 60, 3)).astype(np.float32)
    query, match = (PreparedCloud.of(points, (2.0, 1.0, 0.5), 1) for points in noise)
    settings = RegistrationSettings(global_start="kiss-matcher", yaw_hypotheses=4)
    assert len(global_starts(settings)(query, match, 0.0)) == 4


def test_kiss_matcher_missing_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "kiss_matcher", None)
    with pytest.raises(ConfigError, match=r"not installed; pip install 'wiclosure\[kiss-matcher\]'"):
        global_starts(RegistrationSettings(global_start="kiss-matcher"))
