from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.pictures import draw_errors, draw_funnel
from wiclosure.pipeline.comparison.plan import Plan
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.evaluation.funnel import STAGES
from wiclosure.pipeline.report import pictures
from wiclosure.pipeline.report.pictures import TRUE


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
    counts = [10**6, 10**4, 200, 60, 40, 20, 20]
    known = false is not None
    funnel = [
        {"stage": stage, "count": n, "true": n // 2 if known else None, "false": n // 3 * false if known else None}
        for stage, n in zip(STAGES, counts, strict=True)
    ]
    run = {"ate_m": {"team": ate_m}, "ate_odometry_m": {"team": 0.4}, "funnel": funnel}
    outcomes = [Outcome(s, p, f, Path(), run) for p in presets for f in filters for s in range(seeds)]
    return Comparison(plan, tuple(outcomes))


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
