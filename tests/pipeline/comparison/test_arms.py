"""Arms over small recordings and worlds: what is shared, what is written, and what tables and pictures say."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import ConfigError
from wiclosure.pipeline.cli.compare import make_plan
from wiclosure.pipeline.cli.options import Configuration, Reading
from wiclosure.pipeline.comparison.arms import compare
from wiclosure.pipeline.comparison.figures import FIGURES, closing_seconds, summaries
from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.plan import Plan
from wiclosure.pipeline.comparison.tables import comparison_json, comparison_markdown, write_tables
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.evaluation.funnel import STAGES
from wiclosure.pipeline.report import pictures
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.types import Scan

YARD = ["scenario:demo-site,lidar=vlp16,seed=3"]
SITE = Configuration(config="small-site", set_=["odometry.num_threads=1"])


def room_scans() -> list[Scan]:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (3000, 3)) * [10, 8, 3]
    wall = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), wall] = np.sign(points[np.arange(len(points)), wall]) * np.array([10, 8, 3])[wall]
    return [Scan(10**9 + k * 10**8, points) for k in range(3)]


# ------------------------------------------------------------------------------------------------------------ running
@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    """Few pixels, for speed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "DPI", 40)
        yield


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> tuple[Comparison, Path]:
    """One place seen by two robots, twice the same settings under two names."""
    folder = tmp_path_factory.mktemp("rooms")
    for robot in ("alpha", "beta"):
        write_kitti_folder(folder / robot, room_scans(), T_world_lidar=np.tile(np.eye(4), (3, 1, 1)))
    (folder / "again.yaml").write_text("{}")
    (folder / "out").mkdir()
    data = [f"{robot}={folder / robot}" for robot in ("alpha", "beta")]
    presets = f"strong,{folder / 'again.yaml'}"
    plan = make_plan(data, "none,oracle", presets, configuration=Configuration(), reading=Reading())
    compared = compare(plan, folder / "out", cache=StageCache(None), jobs=1, progress=NoProgress())
    return compared, folder / "out"


def test_what_is_equal_is_computed_once_and_charged_to_every_arm(rooms: tuple[Comparison, Path]) -> None:
    first, again = (rooms[0].arms[preset, "none"][0].metrics for preset in ("strong", "again"))
    assert first["closures"]["verified"] == again["closures"]["verified"] == 1
    for stage in ("odometry", "descriptors", "verification"):
        assert first["seconds"][stage] == again["seconds"][stage] > 0
    assert first["seconds_spent"]["odometry"] == first["seconds"]["odometry"]
    assert again["seconds_spent"]["odometry"] == again["seconds_spent"]["descriptors"] == 0
    assert again["seconds_spent"]["verification"] < first["seconds"]["verification"] / 2
    written = [json.loads((rooms[1] / o.folder / "metrics.json").read_text())["peak_rss_mb"] for o in rooms[0].outcomes]
    assert written[0] > 0
    assert set(written[1:]) == {None}


def test_every_arm_has_its_run_folder_and_shared_pictures_lie_beside_them(rooms: tuple[Comparison, Path]) -> None:
    compared, folder = rooms
    for outcome in compared.outcomes:
        assert outcome.folder == Path(outcome.preset, outcome.filter)
        written = json.loads((folder / outcome.folder / "metrics.json").read_text())
        assert written["seconds"] == outcome.metrics["seconds"]
        assert (folder / outcome.folder / "map.ply").is_file()
        assert (folder / outcome.preset / "trajectories.png").is_file()


@pytest.mark.slow
def test_worlds_differ_by_seed_and_random_keeps_what_wiclosure_kept(tmp_path: Path) -> None:
    plan = make_plan(YARD, "random,wiclosure", seeds=2, configuration=SITE, reading=Reading(n_scans=12))
    assert [world.seed for world in plan.worlds] == [3, 4]
    compared = compare(plan, tmp_path, cache=StageCache(None), jobs=1, progress=NoProgress())
    assert [(o.filter, o.seed) for o in compared.outcomes] == [
        ("random", 3), ("random", 4), ("wiclosure", 3), ("wiclosure", 4)
    ]  # fmt: skip
    for seed in (3, 4):
        random, chosen = (
            next(o.metrics for o in compared.arms["small-site", name] if o.seed == seed)
            for name in ("random", "wiclosure")
        )
        assert random["pairs_total"] > 0
        assert abs(random["pairs_kept"] - chosen["pairs_kept"]) <= 1
        assert (tmp_path / f"seed-{seed}" / "random" / "config.yaml").is_file()
    first, second = (o.metrics["ate_odometry_m"]["team"] for o in compared.arms["small-site", "wiclosure"])
    assert first != second


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("none,magick",), ["magick"]),
        (("none,oracl",), ["oracl", "did you mean oracle"]),
        (("none,none",), ["none is named twice"]),
        (("",), ["--filters"]),
        (("none", "disco-prak"), ["disco-prak", "did you mean disco-park"]),
        (("none", "strong,disco-park,strong"), ["strong is named twice"]),
    ],
)
def test_bad_plans_are_one_sentence(words: tuple[str, ...], parts: list[str]) -> None:
    with pytest.raises(ConfigError) as error:
        make_plan(["alpha"], *words, configuration=Configuration(), reading=Reading())
    for part in parts:
        assert part in str(error.value)


# -------------------------------------------------------------------------------------------------------------- tables
def metrics(ate_m: float | None, seconds: float, false: int = 0) -> dict:
    """`metrics.json` as far as comparisons read it."""
    stages = dict.fromkeys(("odometry", "descriptors", "filter", "matching", "verification", "optimisation"), seconds)
    found = {"precision": 0.5, "recall": 0.9, "false_rejected": 0.75, "pruned": 0.7}
    return {
        "ate_m": {"team": ate_m},
        "ate_horizontal_m": {"team": ate_m},
        "ate_odometry_m": {"team": 0.25},
        "components": [{"robots": ["alpha", "beta"], "ate_m": ate_m}],
        "candidates": found,
        "candidates_registrable": found,
        "closures": {"accepted_true": 8, "accepted_false": false},
        "funnel": [{"stage": stage, "count": 9, "true": 8, "false": 1} for stage in STAGES],
        "seconds": stages | {"mapping": 0.0, "total": 6 * seconds},
        "seconds_spent": stages | {"odometry": 0.0, "mapping": 0.0, "total": 5 * seconds},
        "bytes_exchanged": 1000,
        "peak_rss_mb": None,
    }


def comparison_of(value: Callable[[str, int], dict], seeds: int = 6) -> Comparison:
    plan = Plan({"strong": Config(), "loose": Config()}, ("none", "wiclosure"), ())
    outcomes = tuple(
        Outcome(seed, preset, name, Path(f"seed-{seed}", preset, name), value(name, seed))
        for preset in plan.configs
        for name in plan.filters
        for seed in range(seeds)
    )
    return Comparison(plan, outcomes)


@pytest.fixture
def repeated() -> Comparison:
    """Six worlds in which the filter halves the time, and connects robots that are lost without it in world 0."""
    alone = [None, 10.0, 11.0, 12.0, 13.0, 14.0]
    return comparison_of(lambda name, n: metrics(0.5, 1.0) if name == "wiclosure" else metrics(alone[n], 2.0, false=3))


def test_an_arm_is_compared_seed_by_seed_with_the_base_of_its_preset(repeated: Comparison) -> None:
    base, arm = summaries(repeated)[:2]
    assert (base.preset, base.filter, base.saving_percent, base.against_base) == ("strong", "none", None, {})
    assert (arm.preset, arm.filter, arm.runs) == ("strong", "wiclosure", 6)
    assert arm.saving_percent is not None
    assert arm.saving_percent.median == pytest.approx(50.0)
    assert (arm.against_base["ate_m"].better, arm.against_base["ate_m"].p) == (6, pytest.approx(2 / 64))
    assert arm.against_base["ate_m"].test == "sign test"  # a failure has no size
    assert "Wilcoxon" in arm.against_base["accepted_false"].test
    assert math.isinf(base.figures["ate_m"].largest)
    assert closing_seconds(arm.seconds) == pytest.approx(4.0)


def test_the_csv_has_one_row_for_each_run_and_every_column_is_documented(repeated: Comparison, tmp_path: Path) -> None:
    write_tables(tmp_path, repeated)
    with (tmp_path / "comparison.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 2 * 6
    assert [row["ate_m"] for row in rows[:2]] == ["", "10.0"]
    assert float(rows[6]["saving_percent"]) == pytest.approx(50.0)
    assert (rows[0]["pcm_true"], rows[0]["scan_context_false"]) == ("8", "1")
    documented = (Path(__file__).resolve().parents[3] / "docs" / "comparison.md").read_text(encoding="utf-8")
    stages = {f"seconds_{stage}" for stage in repeated.outcomes[0].metrics["seconds"]}
    counts = {f"{stage.lower().replace(' ', '_')}{of}" for stage in STAGES for of in ("", "_true", "_false")}
    spent = {stage.replace("seconds_", "spent_") for stage in stages}
    for column in set(rows[0]) - stages - counts - spent:
        assert f"`{column}`" in documented, column


def test_json_and_markdown_say_the_same_and_hold_no_infinity(repeated: Comparison) -> None:
    content = json.loads(json.dumps(comparison_json(repeated), allow_nan=False))
    assert set(content) == {"base", "remarks", "arms", "runs"}
    assert content["arms"][0]["figures"]["ate_m"]["largest"] is None
    assert content["runs"][0]["metrics"] == repeated.outcomes[0].metrics
    text = comparison_markdown(repeated)
    assert "not connected" in text
    assert "| strong wiclosure | 6 | 0.5 |" in text
    assert "6.00 / 5.00" in text  # total of the filter's arm, uncached and spent
    assert all(figure.label in text for figure in FIGURES.values())


def test_figures_without_ground_truth_are_left_out() -> None:
    nothing = dict.fromkeys(("precision", "recall", "false_rejected"))

    def unknown(name: str, seed: int) -> dict:
        own = metrics(None, 1.0)
        own |= {"ate_odometry_m": {"team": None}, "candidates": nothing | {"pruned": 0.5}}
        return own | {"closures": {"accepted_true": None, "accepted_false": None}}

    arm = summaries(comparison_of(unknown, seeds=1))[1]
    assert {"ate_m", "accepted_true", "missed_percent"}.isdisjoint(arm.figures)
    assert {"closing_s", "filter_share_percent"} <= set(arm.figures)
    assert "not connected" not in comparison_markdown(comparison_of(unknown, seeds=1))
