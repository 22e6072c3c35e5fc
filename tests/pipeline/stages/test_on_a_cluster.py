"""Stages on a cluster give what they give here, to the last bit, and hand it over by the cache."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import ConfigError
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.scenarios.scenario_source import scenario_inputs
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.cluster.connection import cluster
from wiclosure.pipeline.runtime.cluster.tasks import Cluster
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.odometry import front_ends
from wiclosure.pipeline.stages.registrations import RegistrationPool
from wiclosure.pipeline.stages.stored_clouds import StoredClouds
from wiclosure.types import Closure, KeyframeId, ScanContextMatch

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning"),
]


@pytest.fixture(scope="module")
def dask() -> Iterator[Cluster]:
    pytest.importorskip("distributed")
    with cluster("local:2") as found:
        yield found


def test_odometry_and_registrations(dask: Cluster, tmp_path: Path) -> None:
    inputs, config = scenario_inputs("demo-site", limit=12), Config.model_validate({"keyframes": {"distance_m": 0.3}})
    here, _ = front_ends(inputs.robots, config, cache=StageCache(None), jobs=1, progress=NoProgress())
    cache = StageCache(tmp_path)
    there, reused = front_ends(inputs.robots, config, cache=cache, jobs=1, progress=NoProgress(), workers=dask)
    assert reused == ()
    for robot, front in here.items():
        np.testing.assert_array_equal(front.keyframes.poses, there[robot].keyframes.poses)
        np.testing.assert_array_equal(front.descriptors, there[robot].descriptors)
        assert [cloud.tobytes() for cloud in front.clouds] == [cloud.tobytes() for cloud in there[robot].clouds]
    again = front_ends(inputs.robots, config, cache=cache, jobs=1, progress=NoProgress(), workers=dask)[1]
    assert again == tuple(here)

    clouds = {KeyframeId(robot, k): cloud for robot, front in here.items() for k, cloud in enumerate(front.clouds)}
    alpha, beta = (len(here[robot].clouds) for robot in ("alpha", "beta"))
    proposed = [
        Closure(KeyframeId("alpha", a), KeyframeId("beta", b), scan_context=ScanContextMatch(0.2, 0.1 * (a - b)))
        for a in range(alpha)
        for b in range(beta)
    ]
    proposed = (proposed * (1 + 40 // len(proposed)))[:40]
    proposed = [
        Closure(c.query, c.match, scan_context=ScanContextMatch(0.2, 0.01 * n)) for n, c in enumerate(proposed)
    ]  # as many starts as closures
    stored = {robot: StoredClouds.of(robot, front.clouds, cache) for robot, front in here.items()}
    alone, _ = RegistrationPool(config.registration, clouds).register(proposed, NoProgress())
    moved = dask.costs.bytes_moved
    together, _ = RegistrationPool(config.registration, clouds, {}, dask, stored).register(proposed, NoProgress())
    assert dask.costs.bytes_moved - moved < 1e6  # keys, no clouds
    for one, other in zip(alone, together, strict=True):
        assert (one.query, one.match, one.reason) == (other.query, other.match, other.reason)
        assert (one.measured is None) == (other.measured is None)
        if one.measured is not None and other.measured is not None:
            np.testing.assert_array_equal(one.measured.T_query_match, other.measured.T_query_match)


def test_a_cache_of_its_own_is_told(dask: Cluster, tmp_path: Path) -> None:
    missing = StoredClouds("alpha", tmp_path, "0" * 64)
    with pytest.raises(ConfigError, match=r"the clouds of alpha are not in .*; name a folder that all machines"):
        missing.load()


def test_a_cluster_needs_the_cache(dask: Cluster) -> None:
    robots = scenario_inputs("demo-site", limit=3).robots
    with pytest.raises(ConfigError, match="leave out --no-cache"):
        front_ends(robots, Config(), cache=StageCache(None), jobs=1, progress=NoProgress(), workers=dask)
