"""Pictures are drawn for joined and for unjoined robots, and show what they should."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import OutputError
from wiclosure.types import AoaPath, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.plot import draw_pair, save_pictures

SETTINGS = FilterSettings()


def two_robots(count: int) -> tuple[dict[str, Trajectory], WirelessLog]:
    """Two robots on roads that wind differently, and so many exact measurements with one false path each."""
    x = 3.0 * np.arange(80)
    team, truth = {}, {}
    for name, y0, phase in (("alpha", 0.0, 0.0), ("b/eta", 15.0, 1.0)):
        y = y0 + 15 * np.sin(x / 30 + phase)
        poses = se3.from_yaw(np.arctan2(np.gradient(y), 3.0), np.stack([x, y, 0 * x], axis=1))
        truth[name] = poses
        team[name] = Trajectory(name, np.arange(80, dtype=np.int64) * 10**9, se3.inverse(poses[0]) @ poses)
    heard = []
    for i in np.linspace(0, 79, count).astype(int):
        seen = se3.between(truth["alpha"][i], truth["b/eta"][i])[:3, 3]
        direct = float(np.arctan2(seen[1], seen[0]))
        false = (direct + 1.0 + 0.7 * i + np.pi) % (2 * np.pi) - np.pi
        paths = (AoaPath(false, 0.1), AoaPath(direct, 0.1))
        heard.append(WirelessMeasurement(int(i) * 10**9, "alpha", "b/eta", float(np.linalg.norm(seen)), 0.5, paths))
    return team, WirelessLog(tuple(heard))


def test_joined_robots(tmp_path: Path) -> None:
    team, wireless = two_robots(12)
    result = WiClosureFilter(SETTINGS).candidates(team, wireless)
    links = WiClosureFilter(SETTINGS).gather(team, wireless).by_pair["alpha", "b/eta"]
    figure = draw_pair(result.pairs[0], result.alignments[0], team, links, SETTINGS.gate)
    titles = [axes.get_title() for axes in figure.axes]
    assert any("90 % of b/eta" in title for title in titles)
    assert sum("overlap search, step" in title for title in titles) == 4
    legend = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert "12 kept paths" in legend
    assert "12 rejected paths" in legend
    (path,) = save_pictures(result, team, wireless, SETTINGS, tmp_path / "new")
    assert path.name == "filter_alpha_b_eta.png"
    assert path.stat().st_size > 20_000


def test_unjoined_robots_are_drawn_when_they_heard_each_other(tmp_path: Path) -> None:
    team, wireless = two_robots(1)
    result = WiClosureFilter(SETTINGS).candidates(team, wireless)
    assert len(save_pictures(result, team, wireless, SETTINGS, tmp_path)) == 1
    silent = WiClosureFilter(SETTINGS).candidates(team, WirelessLog())
    assert save_pictures(silent, team, WirelessLog(), SETTINGS, tmp_path) == ()


def test_unwritable_folder(tmp_path: Path) -> None:
    team, wireless = two_robots(12)
    result = WiClosureFilter(SETTINGS).candidates(team, wireless)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write the picture"):
        save_pictures(result, team, wireless, SETTINGS, tmp_path / "file")


def test_drawing_is_not_loaded_with_the_filter() -> None:
    modules = "wiclosure.wiclosure_filter.filter, wiclosure.wiclosure_filter.plot"
    code = f"import sys, {modules}; print('matplotlib' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"
