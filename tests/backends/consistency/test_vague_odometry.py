"""Loops within robots whose covariances say nothing: a metre and a radian for all."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.config import ClosureNoise, PcmSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.types import Closure, KeyframeId, Trajectory

SETTINGS = PcmSettings(noise=ClosureNoise(translation_m=1e-6, rotation_rad=1e-6), max_scale=10.0)
ODOMETRY_SIGMA, SIGMA = np.repeat([0.01, 0.03], 3), np.repeat([0.05, 0.2], 3)
SIDE = 4


def cube(seed, false, *, only_false=False):
    """Odometry of a robot that walks a cube lane by lane, its loops, and which are true."""
    rng = np.random.default_rng(seed)
    lane = [(x if (y + z) % 2 == 0 else SIDE - 1 - x, y, z) for z, y, x in product(range(SIDE), repeat=3)]
    cells = np.array([(x, y if z % 2 == 0 else SIDE - 1 - y, z) for x, y, z in lane], float)
    truth = se3.from_rotation_translation(Rotation.random(len(cells), rng=rng).as_matrix(), cells)
    steps = se3.between(truth[:-1], truth[1:]) @ se3.exp(rng.normal(size=(len(cells) - 1, 6)) * ODOMETRY_SIGMA)
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    stamps_ns, vague = np.arange(len(poses)) * 10**9, np.tile(np.eye(6), (len(steps), 1, 1))
    odometry = {"alpha": Trajectory("alpha", stamps_ns, np.stack(poses), step_covariances=vague)}
    first, second = np.nonzero(np.triu(np.linalg.norm(cells[:, None] - cells, axis=2) < 1.1, 2))
    measured = se3.between(truth[first], truth[second]) @ se3.exp(rng.normal(size=(len(first), 6)) * SIGMA)
    ends = [] if only_false else [*zip(first.tolist(), second.tolist(), measured, strict=True)]
    true = len(ends)
    while len(ends) < true + false:
        i, j = np.sort(rng.integers(0, len(cells), 2)).tolist()
        if j > i + 1:
            T = se3.from_rotation_translation(Rotation.random(1, rng=rng).as_matrix(), rng.normal(0, 1, (1, 3)))[0]
            ends.append((i, j, T))
    keys = [[KeyframeId("alpha", n) for n in (i, j)] for i, j, _ in ends]
    closures = [Closure.from_measurement(*of, T, np.eye(6)) for of, (_, _, T) in zip(keys, ends, strict=True)]
    return odometry, closures, np.arange(len(ends)) < true


def test_false_loops_stay_out_although_nothing_is_stated():
    """Odometry errs less than loops do: under any factor on both, false loops fit better than true ones."""
    odometry, closures, true = cube(1, 75)
    found = pairwise_consistent(closures, odometry, SETTINGS)
    kept = np.array([c.live for c in found.closures])
    assert kept[true].all()
    assert not kept[~true].any()
    assert not found.doubts
    assert found.scale == pytest.approx(SIGMA.max(), rel=0.2)
    assert found.odometry_factors["alpha"] < 0.5
    assert any("alpha errs less than it states" in said for said in found.remarks)


def test_random_loops_alone_tell_no_scale():
    """None that fits them is believed: the map stays in doubt."""
    odometry, closures, _ = cube(2, 15, only_false=True)
    found = pairwise_consistent(closures, odometry, SETTINGS)
    assert found.odometry_factors == {}
    assert found.unchecked or not any(c.live for c in found.closures)
