from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table

from wiclosure.pipeline.cli.comparison_tables import comparison_table, reproduction_table
from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.plan import Plan
from wiclosure.pipeline.config import Config

SECONDS = dict.fromkeys(("filter", "matching", "verification", "optimisation", "total"), 1.0)


def shown(table: Table) -> str:
    console = Console(width=120)
    with console.capture() as capture:
        console.print(table)
    return capture.get()


def run(ate_m: float | None) -> dict:
    """`metrics.json` as far as the table reads it."""
    return {
        "ate_m": {"team": ate_m},
        "ate_odometry_m": {"team": 0.25},
        "pairs_kept": 90,
        "closures": {"proposed": 20, "accepted": 10, "accepted_true": 8, "accepted_false": 2},
        "components": [{"robots": ["alpha", "beta"], "ate_m": ate_m}],
        "candidates": {"recall": 0.9, "false_rejected": 0.75},
        "seconds": SECONDS,
        "seconds_spent": SECONDS,
    }


def test_each_arm_has_a_row() -> None:
    plan = Plan({"strong": Config()}, ("none", "oracle"), ())
    outcomes = (Outcome(0, "strong", "none", Path(), run(None)), Outcome(0, "strong", "oracle", Path(), run(0.5)))
    lines = [line.split() for line in shown(comparison_table(Comparison(plan, outcomes))).splitlines()]
    assert ["none", "1", "not", "connected", "8", "2", "10.0", "4.0", "-"] in lines
    assert ["oracle", "1", "0.50", "8", "2", "10.0", "4.0", "0.0"] in lines


def test_columns_of_the_paper_and_ours_have_two_lines() -> None:
    table = reproduction_table("Table I", ["", "paper: filter", "ours: none"], [["ATE (m)", "1.3", "0.5"]])
    lines = [line.split() for line in shown(table).splitlines()]
    assert ["paper", "ours"] in lines
    assert ["filter", "none"] in lines
    assert ["ATE", "(m)", "1.3", "0.5"] in lines
