from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wiclosure.pipeline import pictures
from wiclosure.pipeline.comparison import Comparison, Outcome, Plan
from wiclosure.pipeline.comparison_pictures import FALSE, TRUE, MergedView, draw_errors, draw_funnel, draw_merged
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.funnel import STAGES

LINE = np.stack([np.linspace(0, 20, 50), np.zeros(50)], axis=1)
BESIDE = LINE + np.array([0.0, 5.0])
VIEW = MergedView(
    paths={"alpha": LINE, "beta": BESIDE},
    truth={"alpha": LINE, "beta": BESIDE},
    closures=np.array([[[x, 0.0], [x, 5.0]] for x in (2.0, 8.0, 14.0)]),
    false=np.array([False, True, True]),
    colours={"alpha": 0, "beta": 1},
    apart=(),
    ate_m=0.5,
)


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Few pixels, for speed."""
    monkeypatch.setattr(pictures, "DPI", 60)


def share_of(path, colour):
    """Share of pixels that have a colour."""
    from matplotlib.image import imread

    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return (np.abs(imread(path)[..., :3] - wanted).max(axis=2) < 0.05).mean()


def comparison(presets, filters, seeds, ate_m=0.5, false=3):
    plan = Plan(dict.fromkeys(presets, Config()), filters, ())
    counts = [10**6, 10**4, 200, 60, 20, 20]
    known = false is not None
    funnel = [
        {"stage": stage, "count": n, "true": n // 2 if known else None, "false": n // 3 * false if known else None}
        for stage, n in zip(STAGES, counts, strict=True)
    ]
    run = {"ate_m": {"team": ate_m}, "ate_odometry_m": {"team": 0.4}, "funnel": funnel}
    outcomes = [Outcome(s, p, f, Path(), run) for p in presets for f in filters for s in range(seeds)]
    return Comparison(plan, tuple(outcomes))


def test_false_closures_stand_out(tmp_path):
    draw_merged(tmp_path / "some.png", {"none": VIEW, "wiclosure": VIEW})
    draw_merged(tmp_path / "no.png", {"none": VIEW, "wiclosure": replace(VIEW, false=np.zeros(3, bool))})
    assert share_of(tmp_path / "some.png", FALSE) > 1.5 * share_of(tmp_path / "no.png", FALSE)
    assert share_of(tmp_path / "no.png", FALSE) > 0


@pytest.mark.parametrize("arms", [1, 2, 5])
def test_any_number_of_arms_is_drawn_even_without_truth_or_closures(tmp_path, arms):
    bare = replace(VIEW, truth={}, closures=np.zeros((0, 2, 2)), false=np.zeros(0, bool), apart=("beta",), ate_m=None)
    draw_merged(tmp_path / "t.png", {str(n): bare for n in range(arms)})
    assert share_of(tmp_path / "t.png", "#0072b2") > 0


@pytest.mark.parametrize("seeds", [1, 5])
@pytest.mark.parametrize("ate_m", [0.5, None])
def test_errors_of_25_arms(tmp_path, seeds, ate_m):
    filters = ("none", "wiclosure", "range-gate", "oracle", "random")
    draw_errors(tmp_path / "ate.png", comparison(["strong", "a", "b", "c", "d"], filters, seeds, ate_m))
    assert (share_of(tmp_path / "ate.png", "#009e73") > 1e-4) == (ate_m is not None)


@pytest.mark.parametrize("false", [3, 0, None])
def test_funnel_of_true_and_false(tmp_path, false):
    draw_funnel(tmp_path / "funnel.png", comparison(["strong"], ("none", "oracle"), 2, false=false))
    assert (share_of(tmp_path / "funnel.png", TRUE) > 1e-3) == (false is not None)
