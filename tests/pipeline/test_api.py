from __future__ import annotations

import doctest
from pathlib import Path

import numpy as np
import pytest

import wiclosure
from wiclosure import (
    Config,
    ConfigError,
    FilterResult,
    InputError,
    Scan,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
    make_filter,
)
from wiclosure.pipeline import api
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder

from .walled_room import room

HEARD = WirelessMeasurement(1_200_000_000, "alpha", "beta", range_m=3.0, range_sigma_m=0.5)


@pytest.fixture
def team(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """Two recordings in a folder of their own, with a cache of its own."""
    monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path / "cache"))
    for number, robot in enumerate(("alpha", "beta")):
        write_kitti_folder(tmp_path / robot, [Scan(10**9 + k * 10**8, room(10 * number + k)) for k in range(4)])
    return {robot: tmp_path / robot for robot in ("alpha", "beta")}


@pytest.mark.filterwarnings("default")  # as a user runs it
def test_the_example_runs() -> None:
    (example,) = (t for t in doctest.DocTestFinder(recurse=False).find(api.run, "run", globs={}) if t.examples)
    assert doctest.DocTestRunner().run(example).failed == 0


def test_recordings_by_name_and_a_data_set_give_the_same(team: dict[str, Path], tmp_path: Path) -> None:
    named = wiclosure.run(team, candidate_filter="none", config={"keyframes": {"distance_m": 0.5}}, wireless=())
    assert list(named.merged) == ["alpha", "beta"]
    assert (named.metrics["filter"], named.config.use_filter, named.config.keyframes.distance_m) == (
        "none",
        "none",
        0.5,
    )
    (tmp_path / "dataset.yaml").write_text("robots: {alpha: {scans: alpha}, beta: {scans: beta}}")
    config = Config.model_validate({"keyframes": {"distance_m": 0.5}, "use_filter": "none"})
    again = wiclosure.run(tmp_path / "dataset.yaml", config=config)
    np.testing.assert_array_equal(again.merged["beta"].poses, named.merged["beta"].poses)
    assert any("taken from the cache" in sentence for sentence in again.metrics["diagnosis"])
    assert len(wiclosure.run(str(tmp_path), config=config, limit=2, cache=False).merged["alpha"]) == 2


def test_without_the_cache_nothing_is_kept(team: dict[str, Path], tmp_path: Path) -> None:
    wiclosure.run(team, candidate_filter="none", cache=False)
    assert not (tmp_path / "cache").exists()


def test_a_log_counts_from_memory_and_from_a_file(team: dict[str, Path], tmp_path: Path) -> None:
    log = WirelessLog([HEARD])  # type: ignore[arg-type]  # lists are converted
    wiclosure.write_wireless_log(tmp_path / "radio.jsonl", log)
    for wireless in (log, tmp_path / "radio.jsonl", [str(tmp_path / "radio.jsonl")]):
        assert wiclosure.run(team, candidate_filter="none", wireless=wireless).inputs.wireless == log


def test_a_filter_of_the_users_own_takes_part(team: dict[str, Path]) -> None:
    class Mine:
        name = "mine"
        asked: tuple[str, ...] = ()

        def candidates(self, trajectories: dict[str, Trajectory], wireless: WirelessLog) -> FilterResult:
            self.asked = tuple(trajectories)
            return make_filter("none").candidates(trajectories, wireless)

    mine = Mine()
    wiclosure.run(team, candidate_filter=mine)  # type: ignore[arg-type]  # a dict will do
    assert mine.asked == ("alpha", "beta")


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"config": {"keyframe": {}}}, ConfigError, r"unknown configuration key keyframe in the settings given"),
        ({"config": "no-such-preset"}, ConfigError, r"configuration no-such-preset not found"),
        ({"candidate_filter": "wifi"}, ConfigError, r"there is no candidate filter 'wifi'; choose one"),
        ({"wireless": "nowhere.jsonl"}, InputError, r"nowhere.jsonl, which does not exist"),
        ({"jobs": 0}, ConfigError, r"jobs is 0"),
        ({"limit": 0}, ConfigError, r"number of scans is 0"),
    ],
)
def test_what_is_wrong_is_said_before_the_work(
    team: dict[str, Path], options: dict[str, object], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        wiclosure.run(team, **options)  # type: ignore[arg-type]


def test_a_preset_is_a_configuration() -> None:
    assert api._config("small-site") != Config()
    assert api._config(None) == Config()


def test_a_function_is_told_the_progress(team: dict[str, Path]) -> None:
    told: list[tuple[str, int, int | None]] = []
    wiclosure.run(team, candidate_filter="none", cache=False, progress=lambda *words: told.append(words))
    assert ("odometry of alpha", 4, 4) in told
