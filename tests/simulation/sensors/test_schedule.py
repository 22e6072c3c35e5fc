"""When links are up; files are read through the radio's tests too (test_radio.py)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.simulation.sensors.schedule import LinkWindow, link_is_up, read_schedule

TIMES_S = np.arange(6.0)


@pytest.mark.parametrize(
    ("windows", "up"),
    [
        (None, [0, 1, 2, 3, 4, 5]),
        ([], []),
        ([LinkWindow(start_s=1, end_s=2)], [1, 2]),
        ([LinkWindow(start_s=1, end_s=2), LinkWindow(start_s=2, end_s=3.5, robot_b="alpha")], [1, 2, 3]),
        ([LinkWindow(start_s=0, end_s=9, robot_a="beta", robot_b="alpha")], [0, 1, 2, 3, 4, 5]),
        ([LinkWindow(start_s=0, end_s=9, robot_a="alpha", robot_b="gamma")], []),
    ],
)
def test_a_link_is_up_in_its_windows(windows: list[LinkWindow] | None, up: list[int]) -> None:
    assert np.flatnonzero(link_is_up(windows, "alpha", "beta", TIMES_S)).tolist() == up


def test_a_file(tmp_path: Path) -> None:
    path = tmp_path / "schedule.csv"
    path.write_text("start_s, end_s, robot_a, robot_b\n0, 10, alpha, \n20, 30.5, alpha, beta\n")
    assert read_schedule(path) == (
        LinkWindow(start_s=0, end_s=10, robot_a="alpha"),
        LinkWindow(start_s=20, end_s=30.5, robot_a="alpha", robot_b="beta"),
    )


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "the columns are none"),
        ("start_s\n1\n", "the columns are start_s; expected start_s,end_s"),
        ("start_s,end_s\n1,2,3\n", "line 2: more values than columns"),
        ("start_s,end_s\n1\n", "line 2: fewer values than columns"),
        ("start_s,end_s\nsoon,2\n", "line 2: start_s and end_s must be seconds >= 0, got 'soon' and '2'"),
        ("start_s,end_s\n-1,2\n", "line 2: start_s and end_s must be seconds >= 0"),
        ("start_s,end_s\n0,1\n3,2\n", r"line 3: the window ends \(2.0 s\) before it starts"),
        ("start_s,end_s,robot_a,robot_b\n0,1,a,a\n", "line 2: a link has two ends, and both are a"),
    ],
)
def test_a_bad_file_is_named_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "schedule.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"schedule\.csv.*{says}"):
        read_schedule(path)
