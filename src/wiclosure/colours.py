"""One colour for each robot, wherever it is shown: report, pictures, viewer, map, terminal."""

from __future__ import annotations

import numpy as np

# Okabe and Ito's palette, told apart with every kind of colour vision, and darker ones of Tol's for larger teams.
ROBOT_COLOURS = np.array(
    [
        (0, 114, 178),
        (230, 159, 0),
        (0, 158, 115),
        (204, 121, 167),
        (86, 180, 233),
        (213, 94, 0),
        (240, 228, 66),
        (51, 34, 136),
        (17, 119, 51),
        (136, 34, 85),
        (102, 60, 20),
        (119, 119, 119),
    ],
    dtype=np.uint8,
)


def robot_rgb(number: int) -> tuple[int, int, int]:
    """Colour of the robot of that number, 0 to 255 each; a thirteenth begins anew."""
    red, green, blue = ROBOT_COLOURS[number % len(ROBOT_COLOURS)].tolist()
    return red, green, blue


def robot_colour(number: int) -> str:
    """The same as `#rrggbb`."""
    return "#{:02x}{:02x}{:02x}".format(*robot_rgb(number))
