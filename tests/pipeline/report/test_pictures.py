from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import OutputError
from wiclosure.pipeline.report import pictures
from wiclosure.pipeline.report.pictures import draw_candidates
from wiclosure.types import CandidatePairs, Closure, KeyframeId, Stage, Trajectory


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Few pixels, for speed."""
    monkeypatch.setattr(pictures, "DPI", 60)


def circle(robot, centre_x):
    angle = np.linspace(0, 2 * np.pi, 50)
    place = np.stack([centre_x + 10 * np.cos(angle), 10 * np.sin(angle), 0 * angle], axis=1)
    return Trajectory(robot, np.arange(50, dtype=np.int64) * 1_000_000_000, se3.from_yaw(angle, place))


TEAM = {"alpha": circle("alpha", 0.0), "beta": circle("beta", 15.0)}
MEASURED = Closure.from_measurement(KeyframeId("alpha", 0), KeyframeId("beta", 25), np.eye(4), np.eye(6))
CLOSURE = MEASURED.accepted(Stage.ESTIMATE)


def pixels(path):
    from matplotlib.image import imread

    return imread(path)[..., :3]


def share_of(image, colour):
    """Share of pixels that have a colour."""
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return (np.abs(image - wanted).max(axis=2) < 0.03).mean()


def test_candidates_show_what_was_kept_and_what_was_missed(tmp_path):
    every = np.arange(50)
    arms = {
        "none": CandidatePairs.without_prediction("alpha", "beta", *(x.ravel() for x in np.indices((50, 50)))),
        "diagonal": CandidatePairs.without_prediction("alpha", "beta", every, every),
    }
    draw_candidates(tmp_path / "c.png", arms, keyframes=TEAM, closures={"none": [CLOSURE]}, truth=TEAM, radius_m=10.0)
    image = pixels(tmp_path / "c.png")[:-60]
    left, right = image[:, : image.shape[1] // 2], image[:, image.shape[1] // 2 :]
    assert share_of(left, "#0072b2") > 0.05  # kept and true
    assert share_of(left, "#c9d3da") > 0.3  # kept and false
    assert share_of(left, "#f2b48c") == 0.0
    assert share_of(right, "#f2b48c") > 0.05  # missed


def test_candidates_without_ground_truth_are_drawn(tmp_path):
    pairs = CandidatePairs.without_prediction("alpha", "beta", np.zeros(0, np.int64), np.zeros(0, np.int64))
    draw_candidates(tmp_path / "c.png", {"none": pairs}, keyframes=TEAM, closures={}, truth={}, radius_m=10.0)
    assert share_of(pixels(tmp_path / "c.png")[:-60], "#0072b2") == 0.0


def test_a_missing_folder_is_named(tmp_path):
    pairs = CandidatePairs.without_prediction("alpha", "beta", np.zeros(0, np.int64), np.zeros(0, np.int64))
    with pytest.raises(OutputError, match="nowhere"):
        draw_candidates(
            tmp_path / "nowhere" / "c.png", {"none": pairs}, keyframes=TEAM, closures={}, truth={}, radius_m=9
        )
