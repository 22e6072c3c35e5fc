from __future__ import annotations

import numpy as np

from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise
from wiclosure.backends.estimate.measurements import Measurements


def test_groups_follow_the_closures_that_are_left(team_maker):
    team = team_maker(0, ("alpha", "beta", "gamma"))
    closures = [team.closure((a, 3), (b, 7)) for a, b in (("alpha", "beta"), ("alpha", "beta"), ("beta", "gamma"))]
    sets, _ = closure_sets(closures, team.odometry, ClosureNoise())
    measured = Measurements(team.odometry, sets)
    masks = [np.arange(len(z)) < (1 if len(z) == 2 else 0) for z in sets]
    left = measured.among(masks)
    assert (measured.closures, left.closures) == (3, 1)
    assert measured.groups == (("alpha", "beta", "gamma"),)
    assert left.groups == (("alpha", "beta"), ("gamma",))
