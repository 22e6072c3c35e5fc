"""Score tests of constant errors, against least squares over poses and errors together."""

from __future__ import annotations

import numpy as np

from wiclosure.backends.config import ClosureNoise, PcmSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.backends.consistency.steady_errors import _Tested

ROBOTS = ("alpha", "beta", "gamma")


def test_scores_are_what_least_squares_over_poses_and_error_gains(team_maker):
    team, rng = team_maker(3, ROBOTS, noise=1.0), np.random.default_rng(3)
    ends = [(a, b, *rng.integers(0, 60, 2)) for a in ROBOTS for b in ROBOTS if a <= b for _ in range(8)]
    closures = [team.closure((a, int(i)), (b, int(j)), noise=rng) for a, b, i, j in ends if a != b or abs(i - j) > 5]
    noise = ClosureNoise(translation_m=1e-3, rotation_rad=1e-3)
    basis = pairwise_consistent(closures, team.odometry, PcmSettings(noise=noise)).basis
    assert basis is not None
    arrays, merged = basis
    tested = _Tested.of(arrays, merged.restated(arrays.robots), merged, team.odometry)

    edges, (by_first, by_second) = tested.system.edges, tested.jacobians
    J = np.zeros((len(edges), 6, tested.system.size, 6))
    J[np.arange(len(edges)), :, edges.first], J[np.arange(len(edges)), :, edges.second] = by_first, by_second
    J = np.delete(J, tested.system.held, axis=2).reshape(6 * len(edges), -1)
    r = tested.residuals.ravel()
    before = np.linalg.lstsq(J, r, rcond=None)[1].sum()
    gained = []
    for robot, component in tested.columns.tolist():
        rows, moves = tested.moves[robot]
        A = np.zeros((len(edges), 6, 1))
        A[rows] = tested.system.W[rows] @ moves[:, :, component, None]
        gained.append(before - np.linalg.lstsq(np.hstack([J, A.reshape(-1, 1)]), r, rcond=None)[1].sum())
    assert len(gained) == 18
    np.testing.assert_allclose(tested.scores(), gained, rtol=1e-4, atol=1e-6)
