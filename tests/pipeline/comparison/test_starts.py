"""Arms agree or not on where the robots start, without ground truth."""

from __future__ import annotations

from collections.abc import Callable

from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.comparison.starts import has_truth, start_rows


def start(x_m: float, yaw_deg: float) -> dict:
    return {"alpha-beta": {"x_m": x_m, "y_m": 0.0, "z_m": 0.0, "yaw_deg": yaw_deg, "pitch_deg": 0.0, "roll_deg": 0.0}}


def test_arms_are_held_against_the_first_that_connects(
    run_metrics: Callable[..., dict], comparison_of: Callable[..., Comparison]
) -> None:
    starts = {("none", 0): {}, ("wiclosure", 0): start(3.0, 179.0), ("none", 1): start(0, 0), ("wiclosure", 1): {}}

    def run(name: str, seed: int) -> dict:
        return run_metrics(None, 1.0) | {"ate_odometry_m": {"team": None}, "starts": starts[name, seed]}

    compared = comparison_of(run, seeds=2)
    assert not has_truth(compared)
    rows = start_rows(compared)
    assert rows[0][:2] == ["strong: none", "alpha-beta"]
    assert rows[0][-1] == "not connected"
    assert [row[-1] for row in rows if row[0] == "strong: wiclosure"] == ["", "not connected"]
    assert [row[-1] for row in rows if row[0] == "loose: wiclosure"] == ["0.00 m, 0.00 deg", "not connected"]


def test_turns_go_the_short_way(run_metrics: Callable[..., dict], comparison_of: Callable[..., Comparison]) -> None:
    def run(name: str, seed: int) -> dict:
        return run_metrics(1.0, 1.0) | {"starts": start(3.0, 179.0) if name == "none" else start(0.0, -179.0)}

    assert has_truth(comparison_of(run, seeds=1))
    assert start_rows(comparison_of(run, seeds=1))[1][-1] == "3.00 m, 2.00 deg"
