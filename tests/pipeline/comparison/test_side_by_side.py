"""Worlds of a comparison side by side: the same to the last bit as one after the other, and all that was said."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from wiclosure.errors import ConfigError, InputError
from wiclosure.pipeline.cli.compare import make_plan
from wiclosure.pipeline.cli.options import Configuration, RecordingOptions
from wiclosure.pipeline.comparison.arms import _side_by_side, _with_odometry, compare
from wiclosure.pipeline.comparison.one_world import Arms
from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.comparison.plan import Plan
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.cluster.connection import cluster
from wiclosure.pipeline.runtime.log import json_log
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.workers import ThisProcess

pytestmark = pytest.mark.usefixtures("coarse")

FILES = ("config.yaml", "candidates.csv", "closures.csv", "alpha.tum", "beta.tum", "map.ply", "graph.g2o")


class Bars(NoProgress):
    """Keeps what bars would show."""

    def __init__(self) -> None:
        self.shown: dict[str, list[int]] = {}

    @contextmanager
    def together(self, totals: Mapping[str, int], label: str) -> Iterator[Callable[[str, int], None]]:
        """See `Progress`."""
        yield lambda name, done: self.shown.setdefault(f"{label} {name}", []).append(done)


def plan_of(seeds: int, *, scans: int = 6, filters: str = "none,wiclosure") -> Plan:
    settings = Configuration(config="small-site", set_=["keyframes.distance_m=0.2"])
    words = ["scenario:demo-site,lidar=vlp16,seed=3"]
    return make_plan(words, filters, seeds=seeds, configuration=settings, reading=RecordingOptions(n_scans=scans))


def test_a_world_tells_how_far_it_is_and_what_it_logged(tmp_path: Path) -> None:
    bars, plan = Bars(), plan_of(1, scans=2, filters="none")
    every = [Arms(world, plan, tmp_path, StageCache(None)) for world in plan.worlds]
    with json_log(tmp_path / "log.jsonl"):
        outcomes = _side_by_side(every, ThisProcess(), bars)
    assert [o.seed for o in outcomes] == [3]
    assert bars.shown.keys() == {"percent of seed 3"}
    assert all(sorted(told) == told and told[0] < told[-1] == 100 for told in bars.shown.values())
    logged = [json.loads(line)["message"] for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    said = [sentence for outcome in outcomes for sentence in outcome.metrics["diagnosis"]]
    assert said
    assert set(said) <= set(logged)


def test_odometry_that_was_done_for_all_worlds_is_charged_to_the_first_arm(tmp_path: Path) -> None:
    bars, plan, cache = Bars(), plan_of(2, scans=2, filters="none"), StageCache(tmp_path / "cache")
    every = [Arms(world, plan, tmp_path / "out", cache) for world in plan.worlds]
    done = _with_odometry(every, ThisProcess(), bars)
    names = {f"{robot}, seed {seed}" for robot in ("alpha", "beta") for seed in (3, 4)}
    assert {name: told[-1] for name, told in bars.shown.items()} == {f"odometry of {name}": 2 for name in names}
    assert [arms.cached for arms in done] == [{0: ()}, {0: ()}]
    assert [arms.cached for arms in _with_odometry(every, ThisProcess(), bars)] == [{0: ("alpha", "beta")}] * 2
    for arms, spent in ((done[0], True), (every[0], False)):  # the second as if another invocation had done it
        (outcome,) = arms.run(jobs=1, progress=NoProgress())
        seconds = outcome.metrics["seconds_spent"]["odometry"], outcome.metrics["seconds"]["odometry"]
        assert (seconds[0] == seconds[1]) == spent
        assert (seconds[0] == 0) != spent


def test_an_error_names_the_world(tmp_path: Path) -> None:
    def missing() -> Inputs:
        raise InputError("alpha.bag does not exist")

    plan = plan_of(2)
    plan = replace(plan, worlds=tuple(replace(world, inputs=missing) for world in plan.worlds))
    with pytest.raises(InputError, match=r"^seed 3: alpha.bag does not exist$"):
        compare(plan, tmp_path, cache=StageCache(None), jobs=1, progress=NoProgress())


def test_a_folder_that_workers_do_not_see_is_named(tmp_path: Path) -> None:
    plan = plan_of(2)
    every = [Arms(plan.worlds[0], plan, tmp_path / "elsewhere", StageCache(None))]
    with pytest.raises(ConfigError, match=r"a worker does not see .*elsewhere: all workers must share the folder"):
        _side_by_side(every, ThisProcess(), NoProgress())


# --------------------------------------------------------------------------------------------- the same to the last bit
@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> tuple[Comparison, Path]:
    folder = tmp_path_factory.mktemp("alone")
    return compare(plan_of(3), folder, cache=StageCache(None), jobs=1, progress=NoProgress()), folder


def require_same(compared: Comparison, folder: Path, alone: tuple[Comparison, Path]) -> None:
    """The same arms, files and figures."""
    expected = {(o.filter, o.seed): o for o in alone[0].outcomes}
    for outcome in compared.outcomes:
        for name in FILES:
            one, other = folder / outcome.folder / name, alone[1] / outcome.folder / name
            assert one.read_bytes() == other.read_bytes(), one
        for figure in ("pairs_kept", "closures", "ate_m", "diagnosis"):
            assert outcome.metrics[figure] == expected[outcome.filter, outcome.seed].metrics[figure]
        assert outcome.metrics["seconds_spent"]["odometry"] == (
            outcome.metrics["seconds"]["odometry"] if outcome.filter == "none" else 0
        )


@pytest.mark.slow
def test_as_many_worlds_as_workers(tmp_path: Path, alone: tuple[Comparison, Path]) -> None:
    compared = compare(plan_of(2), tmp_path, cache=StageCache(None), jobs=2, progress=NoProgress())
    require_same(compared, tmp_path, alone)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_on_a_cluster(tmp_path: Path, alone: tuple[Comparison, Path]) -> None:
    pytest.importorskip("distributed")
    (tmp_path / "out").mkdir()
    cache = StageCache(tmp_path / "cache")
    with cluster("local:2") as dask:
        compared = compare(plan_of(3), tmp_path / "out", cache=cache, jobs=1, progress=NoProgress(), cluster=dask)
        assert len(dask.costs.workers) == 2
    require_same(compared, tmp_path / "out", alone)
    assert [o.seed for o in compared.outcomes] == [3, 4, 5, 3, 4, 5]
