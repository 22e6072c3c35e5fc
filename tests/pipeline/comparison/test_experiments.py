"""What is copied from the paper agrees with itself, and with what it is run by."""

from __future__ import annotations

import re

import pytest

from wiclosure.pipeline.comparison.experiments import EXPERIMENTS
from wiclosure.pipeline.presets import preset_names
from wiclosure.simulation.scenarios.registry import SCENARIOS


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_an_experiment_names_a_scenario_and_presets_that_exist(name: str) -> None:
    experiment = EXPERIMENTS[name]
    assert experiment.scenario in SCENARIOS
    assert {*experiment.presets, *([experiment.site] if experiment.site else [])} <= set(preset_names())
    assert [row[0] for row in experiment.paper] == [row[0] for row in EXPERIMENTS["kitti08"].paper]


def figures(text: str) -> list[float]:
    return [float(figure.replace(",", "")) for figure in re.findall(r"\d[\d,]*(?:\.\d+)?", text)]


def test_the_sums_behind_the_contradictions_are_right() -> None:
    missed, rejected, total, _, _ = EXPERIMENTS["kitti08"].contradictions
    assert 100 * figures(missed)[1] / figures(missed)[2] == pytest.approx(figures(missed)[3], abs=0.05)
    assert 100 * (1 - figures(rejected)[1] / figures(rejected)[2]) == pytest.approx(99.7, abs=0.05)
    assert 464 - 53 == 411
    assert {464.0, 53.0, 411.0} <= set(figures(total))
    hall = EXPERIMENTS["shell-space"].contradictions
    assert figures(hall[1])[-1] == pytest.approx(100 * (1 - 119 / 1848), abs=0.05)
    true = round(115 / 0.85)
    assert {float(true), 1848.0 - true, 119.0 - 115.0} <= set(figures(hall[0]))
