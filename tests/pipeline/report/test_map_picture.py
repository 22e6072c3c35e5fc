from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread

from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.colours import ROBOT_COLOURS, robot_colour
from wiclosure.errors import OutputError
from wiclosure.pipeline.report import pictures
from wiclosure.pipeline.report.map_picture import draw_map

LINE = np.column_stack([np.linspace(-30, 30, 50), np.zeros(50), np.zeros(50)])
NOWHERE = np.zeros((0, 3))


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "DPI", 100)


def wall(y_m: float, robot: int, points: int = 20_000) -> MergedMap:
    rng = np.random.default_rng(0)
    xyz = np.column_stack([rng.uniform(-30, 30, points), y_m + rng.uniform(0, 2, points), rng.uniform(0, 3, points)])
    return MergedMap(xyz.astype(np.float32), np.tile(ROBOT_COLOURS[robot], (points, 1)))


def share_of(image: np.ndarray, colour: tuple[float, float, float]) -> float:
    return float((np.abs(image - colour).max(axis=2) < 0.06).mean())


def pale(robot: int) -> tuple[float, float, float]:
    red, green, blue = 1 - 0.65 * (1 - ROBOT_COLOURS[robot] / 255)
    return float(red), float(green), float(blue)


def test_points_are_pale_and_paths_are_not(tmp_path: Path) -> None:
    draw_map(tmp_path / "map.png", wall(8.0, 1), {"alpha": LINE, "beta": LINE - [0, 5, 0], "gamma": NOWHERE})
    image = imread(tmp_path / "map.png")[..., :3]
    assert share_of(image, pale(1)) > 0.005
    for robot in (0, 1):
        assert share_of(image, to_rgb(robot_colour(robot))) > 1e-3
    assert share_of(image, to_rgb(robot_colour(2))) == 0


def test_points_far_off_do_not_shrink_the_rest(tmp_path: Path) -> None:
    near = wall(8.0, 1)
    far = MergedMap(
        np.vstack([near.points, [[1e5, 1e5, 0]]]).astype(np.float32), np.vstack([near.colours, [[0, 0, 0]]])
    )
    for name, shown in (("near", near), ("far", far)):
        draw_map(tmp_path / f"{name}.png", shown, {"alpha": LINE})
    assert (tmp_path / "near.png").read_bytes() == (tmp_path / "far.png").read_bytes()


def test_an_empty_map_and_a_robot_that_stands_are_drawn_and_a_missing_folder_is_named(tmp_path: Path) -> None:
    empty = MergedMap(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8))
    draw_map(tmp_path / "map.png", empty, {"alpha": LINE[:1]})
    assert (tmp_path / "map.png").stat().st_size > 1000
    with pytest.raises(OutputError, match="nowhere"):
        draw_map(tmp_path / "nowhere" / "map.png", empty, {"alpha": LINE})
