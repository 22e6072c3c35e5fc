from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.edges import degrees_of_freedom, degrees_of_true_ones


def test_what_stays_in_the_plane_has_three_degrees_of_freedom():
    flat = se3.from_yaw(np.linspace(-3, 3, 5), np.array([[x, 2.0, 0.0] for x in range(5)]))
    assert degrees_of_freedom(flat, flat[:0]) == 3
    assert degrees_of_freedom(flat, flat @ se3.exp(np.array([0, 0.01, 0, 0, 0, 0]))) == 6
    assert degrees_of_freedom(flat @ se3.exp(np.array([0, 0, 0, 0, 0, 0.01]))) == 6


def test_false_loops_in_space_leave_a_planar_graph_its_three_degrees_of_freedom():
    flat = se3.from_yaw(np.linspace(-3, 3, 5), np.array([[x, 2.0, 0.0] for x in range(5)]))
    tilted = flat @ se3.exp(np.array([0, 0.5, 0, 0, 0, 0]))
    assert degrees_of_true_ones(flat, np.concatenate([flat, tilted[:4]])) == 3
    assert degrees_of_true_ones(flat, np.concatenate([flat[:2], tilted])) == 6
    assert degrees_of_true_ones(tilted, flat) == 6
