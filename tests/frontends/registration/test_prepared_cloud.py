from __future__ import annotations

import numpy as np

from wiclosure.frontends.registration.prepared_cloud import PreparedCloud, PreparedClouds
from wiclosure.types import KeyframeId


def test_a_cloud_is_prepared_once_while_it_is_at_hand() -> None:
    clouds = PreparedClouds(capacity=2, num_threads=1)
    points = {i: np.random.default_rng(i).uniform(-5, 5, (500, 3)).astype(np.float32) for i in range(3)}
    first = clouds.get(KeyframeId("alpha", 0), points[0], (1.0, 0.5))
    assert clouds.get(KeyframeId("alpha", 0), points[0], (1.0, 0.5)) is first
    another = clouds.get(KeyframeId("alpha", 0), points[0].copy(), (1.0, 0.5))
    assert another is not first  # another array under the same name: another run
    for i in (1, 2):
        clouds.get(KeyframeId("alpha", i), points[i], (1.0, 0.5))
    assert clouds.get(KeyframeId("alpha", 0), points[0], (1.0, 0.5)) is not another  # the oldest had to go


def test_what_stands_on_the_ground_is_structure_and_the_ground_is_not() -> None:
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-30, 30, (9000, 2)), np.full(9000, -1.7)])
    wall = np.column_stack([rng.uniform(-20, 20, 6000), np.full(6000, 8.0), rng.uniform(-1.2, 5, 6000)])
    prepared = PreparedCloud.of(np.concatenate([ground, wall]).astype(np.float32), (1.0, 0.5), 1)
    assert len(prepared.structure) > 500
    assert np.mean(np.abs(prepared.structure[:, 1] - 8.0) < 0.3) > 0.95
    assert [len(level.points) < 15000 for level in prepared.levels] == [True, True]
