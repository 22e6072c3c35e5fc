"""A world from above."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.image import imread

from wiclosure.colours import robot_colour
from wiclosure.errors import OutputError
from wiclosure.pipeline.report import pictures
from wiclosure.pipeline.report.plan_view import draw_plan
from wiclosure.simulation.scenario import Scenario
from wiclosure.simulation.sensors.lidar import lidar_model
from wiclosure.simulation.sensors.radio import RadioSettings
from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.mesh import box, pole
from wiclosure.simulation.world.motion import MotionSettings, drive
from wiclosure.simulation.world.scene import SceneBuilder

SOLID, SLIGHT = "#777777", "#8cbf8c"


@pytest.fixture(autouse=True)
def fine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Enough pixels for a thin line to have its colour."""
    monkeypatch.setattr(pictures, "DPI", 200)


def scenario(*, building: bool, roof: bool = False) -> Scenario:
    """One robot that drives 40 m along x; 8 m beside it a building of 20 x 6 m, a thick pole, a roof on nothing."""
    ground = rough_ground(np.random.default_rng(0), (-40.0, -40.0), (40.0, 40.0), 0.0)
    builder = SceneBuilder(ground)
    if building:
        builder.stand(box(20.0, 6.0, 5.0), 0.0, 8.0)
        builder.plant(pole(6.0, 2.0), 16.0, 8.0)
    if roof:
        builder.hang(box(20.0, 6.0, 0.3).at(0.0, 8.0, 4.0))
    motion = drive(np.array([[-20.0, 0.0], [20.0, 0.0]]), ground, MotionSettings())
    return Scenario("plan", builder.build(), {"alpha": motion}, lidar_model("vlp16"), RadioSettings(), 0)


def widest(image: np.ndarray, colour: str) -> float:
    """Largest share of a row of pixels that has a colour: of something long along x."""
    wanted = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return float((np.abs(image - wanted).max(axis=2) < 0.05).mean(axis=1).max())


def test_what_stands_and_where_robots_drive_is_drawn(tmp_path: Path) -> None:
    draw_plan(scenario(building=True), tmp_path / "plan.png")
    draw_plan(scenario(building=False), tmp_path / "empty.png")
    plan, empty = (imread(tmp_path / f"{name}.png")[..., :3] for name in ("plan", "empty"))
    assert widest(plan, SOLID) > 0.2 > widest(empty, SOLID)
    assert widest(plan, SLIGHT) > widest(empty, SLIGHT) == 0
    assert min(widest(plan, to_hex(robot_colour(0))), widest(empty, to_hex(robot_colour(0)))) > 0.4


def test_roofs_hide_nothing(tmp_path: Path) -> None:
    draw_plan(scenario(building=False, roof=True), tmp_path / "plan.png")
    assert widest(imread(tmp_path / "plan.png")[..., :3], SOLID) < 0.2


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="nowhere"):
        draw_plan(scenario(building=True), tmp_path / "nowhere" / "plan.png")
