from __future__ import annotations

from io import BytesIO

import numpy as np
from matplotlib.colors import to_hex

from wiclosure import CandidatePairs
from wiclosure.colours import robot_colour
from wiclosure.display import plot_kept_pairs, plot_paths

LINE = np.column_stack([np.linspace(0, 10, 20), np.zeros(20), np.zeros(20)])


def test_every_robot_has_its_colour_and_one_that_is_apart_its_panel() -> None:
    closures = np.array([[LINE[0], LINE[3]]])
    figure = plot_paths({"a": LINE, "$b": LINE + 1, "c": LINE}, closures, apart=["c"])
    together, apart = figure.axes
    colours = {line.get_label(): to_hex(line.get_color()) for axes in figure.axes for line in axes.lines}
    assert [colours[robot] for robot in ("a", "$b", "c")] == [robot_colour(n) for n in range(3)]
    assert {line.get_label() for line in together.lines} >= {"a", "$b"}
    assert apart.get_title() == "not connected: c"
    assert together.get_title() == "1 closure"
    figure.savefig(BytesIO(), format="png")  # a name like a formula stops nothing


def test_kept_pairs_lie_at_their_keyframes() -> None:
    pairs = CandidatePairs.without_prediction("a", "b", np.array([1, 2]), np.array([7, 8]))
    (axes,) = plot_kept_pairs([pairs]).axes
    assert axes.collections[0].get_offsets().tolist() == [[7, 1], [8, 2]]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("keyframe of b", "keyframe of a")
    plot_kept_pairs([]).savefig(BytesIO(), format="png")
