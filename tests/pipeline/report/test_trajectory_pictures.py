from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from wiclosure.errors import OutputError
from wiclosure.pipeline.report import pictures
from wiclosure.pipeline.report.pictures import FALSE
from wiclosure.pipeline.report.trajectory_pictures import MergedView, draw_merged, draw_run

ANGLE = np.linspace(0, 2 * np.pi, 60)
RING = 10 * np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=1)
TEAM = {"alpha": RING, "beta": RING + np.array([8.0, 5.0])}
VIEW = MergedView(
    odometry={"alpha": RING, "beta": RING + np.array([2.0, 0.0])},
    paths=TEAM,
    truth=TEAM,
    closures=np.array([[[x, 0.0], [x, 5.0]] for x in (2.0, 8.0, 14.0)]),
    false=np.array([False, True, True]),
    ate_m=0.5,
)
ALPHA, BETA = "#0072b2", "#e69f00"


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Few pixels, for speed."""
    monkeypatch.setattr(pictures, "DPI", 80)


def pixels(path):
    from matplotlib.image import imread

    return imread(path)[..., :3]


def share_of(image, colour):
    """Share of pixels that have a colour."""
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return (np.abs(image - wanted).max(axis=2) < 0.05).mean()


def test_a_run_shows_every_robot_before_and_after(tmp_path):
    draw_run(tmp_path / "t.png", VIEW)
    image = pixels(tmp_path / "t.png")[:-60]
    for half in (image[:, : image.shape[1] // 2], image[:, image.shape[1] // 2 :]):
        assert share_of(half, BETA) > 3e-4


def test_robots_that_are_not_connected_are_not_drawn_into_a_frame_that_is_not_theirs(tmp_path):
    apart = replace(VIEW, paths={"alpha": RING}, truth={}, closures=np.zeros((0, 2, 2)), false=np.zeros(0, bool))
    draw_run(tmp_path / "t.png", apart)
    image = pixels(tmp_path / "t.png")
    right = image[:-60, image.shape[1] // 2 :]
    assert share_of(right, ALPHA) > 3e-4
    beta = np.argwhere(np.abs(right - to_rgb(BETA)).max(axis=2) < 0.05)
    assert len(beta)  # in a box of its own: below and to the right, not over the others' frame
    assert beta[:, 0].min() > 0.4 * right.shape[0]
    assert beta[:, 1].min() > 0.5 * right.shape[1]


def test_before_merging_each_robot_has_a_place_of_its_own(tmp_path):
    far = replace(VIEW, odometry={"alpha": RING + 1e4, "beta": RING})
    draw_run(tmp_path / "t.png", far)
    image = pixels(tmp_path / "t.png")[:-60]
    left = image[:, : image.shape[1] // 2]
    alpha, beta = (np.argwhere(np.abs(left - to_rgb(colour)).max(axis=2) < 0.05) for colour in (ALPHA, BETA))
    assert (alpha.max(axis=0) < beta.min(axis=0)).any()  # beside each other or one below the other
    height, width = np.ptp(alpha, axis=0)
    assert min(height, width) > 0.2 * left.shape[0]  # and both large enough to be seen


def test_a_robot_that_is_not_connected_covers_no_other(tmp_path):
    """What is drawn of the connected one is the same whether the other is there or not."""
    apart = replace(VIEW, paths={"alpha": VIEW.paths["alpha"]}, closures=np.zeros((0, 2, 2)), false=np.zeros(0, bool))
    draw_merged(tmp_path / "t.png", {"one": replace(apart, truth={})})
    image = pixels(tmp_path / "t.png")
    alpha, beta = (np.argwhere(np.abs(image - to_rgb(colour)).max(axis=2) < 0.05)[:, 1] for colour in (ALPHA, BETA))
    alpha, beta = (side[side < image.shape[1]] for side in (alpha, beta))
    assert np.quantile(alpha, 0.9) < np.quantile(beta, 0.1)


def test_false_closures_stand_out(tmp_path):
    draw_merged(tmp_path / "some.png", {"none": VIEW, "wiclosure": VIEW})
    draw_merged(tmp_path / "no.png", {"none": replace(VIEW, false=np.zeros(3, bool))})
    assert share_of(pixels(tmp_path / "some.png"), FALSE) > 3e-4
    assert share_of(pixels(tmp_path / "no.png"), FALSE) == 0


@pytest.mark.parametrize("arms", [1, 2, 5])
def test_any_number_of_arms_is_drawn_even_without_truth_or_closures(tmp_path, arms):
    bare = replace(VIEW, truth={}, closures=np.zeros((0, 2, 2)), false=np.zeros(0, bool), ate_m=None)
    draw_merged(tmp_path / "t.png", {str(n): bare for n in range(arms)})
    assert share_of(pixels(tmp_path / "t.png"), BETA) > 3e-4


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(OutputError, match="nowhere"):
        draw_run(tmp_path / "nowhere" / "picture.png", VIEW)


def test_names_that_look_like_formulas_are_names(tmp_path):
    name = r"a$\frac$b_{"
    odd = replace(VIEW, odometry={name: RING, "beta": RING}, paths={name: RING}, truth={})
    draw_merged(tmp_path / "t.png", {name: odd})
    draw_run(tmp_path / "u.png", odd)
    assert share_of(pixels(tmp_path / "t.png"), ALPHA) > 3e-4
