"""The paper's tables beside ours."""

from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.errors import ConfigError
from wiclosure.pipeline.comparison.experiments import EXPERIMENTS
from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.reproduction import ARMS, plan_of, reproduction_report, tables, verdicts


def metrics(ate_m: float | None, total_s: float) -> dict:
    """`metrics.json` as far as the tables read it."""
    stages = dict.fromkeys(("odometry", "descriptors", "matching", "verification", "optimisation", "mapping"), 1.0)
    return {
        "ate_m": {"team": ate_m},
        "ate_odometry_m": {"team": 0.25},
        "pairs_total": 1000,
        "pairs_kept": 100,
        "candidates": {"recall": 0.875, "false_rejected": 0.96875},
        "closures": {
            "proposed": 20, "accepted": 8, "accepted_true": 8,
            "accepted_false": 5 if ate_m is None or ate_m > 5 else 0,
        },
        "components": [{"robots": ["alpha", "beta"], "ate_m": ate_m}],
        "seconds": stages | {"filter": 0.5, "total": total_s},
        "seconds_spent": stages | {"filter": 0.5, "total": total_s},
    }  # fmt: skip


def reproduced(name: str, lost_alone: float | None) -> Comparison:
    poses = Path("08.txt") if EXPERIMENTS[name].needs_poses else None
    experiment, plan = plan_of(name, poses=poses, seeds=3)
    outcomes = tuple(
        Outcome(seed, preset, chosen, Path(), metrics(lost_alone if chosen == "none" else 0.5, 40.0 + seed))
        for preset in experiment.presets
        for chosen in ARMS
        for seed in range(3)
    )
    return Comparison(plan, outcomes)


@pytest.mark.parametrize("name", EXPERIMENTS)
@pytest.mark.parametrize("lost_alone", [None, 17.0])
def test_every_row_of_the_paper_stands_beside_ours(name: str, lost_alone: float | None) -> None:
    experiment, compared = EXPERIMENTS[name], reproduced(name, lost_alone)
    assert list(tables(experiment, compared)) == list(experiment.presets)
    for header, rows in tables(experiment, compared).values():
        assert all(len(row) == len(header) == 3 + len(ARMS) for row in rows)
        assert [tuple(row[:3]) for row in rows[:5]] == list(experiment.paper)
        by_label = {row[0]: row[3:] for row in rows}
        assert by_label["ATE (m)"] == ["17" if lost_alone else "not connected", "0.50", "0.50"]
        assert set(by_label["Missed true LC (%)"]) == {"12.5"}
        assert by_label["Total Computation Time (s)"][0] == "41.0 [40.0, 42.0]"
    text = reproduction_report(experiment, compared)
    assert all(sentence in text for sentence in experiment.contradictions)
    assert "first 40 scans" not in text
    assert "first 40 scans" in reproduction_report(experiment, compared, 40)
    assert f"{experiment.presets[0]} with none fails in 3 of 3 worlds; false closures are accepted in 3" in text
    assert f"{experiment.presets[0]} with wiclosure does not fail (0 of 3 worlds)" in text


def test_a_baseline_that_does_not_fail_is_said_not_to() -> None:
    assert verdicts(reproduced("shell-space", 0.6))[0] == (
        "disco-park with none does not fail (0 of 3 worlds); false closures are accepted in 0."
    )


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("kitti8", None), ["kitti8", "did you mean kitti08"]),
        (("kitti08", None), ["--poses"]),
        (("shell-space", Path("08.txt")), ["takes no --poses"]),
    ],
)
def test_bad_words(words: tuple[str, Path | None], parts: list[str]) -> None:
    with pytest.raises(ConfigError) as error:
        plan_of(words[0], poses=words[1])
    for part in parts:
        assert part in str(error.value)
