"""A linearised graph of many chains of poses in a plan, each joined with those beside it."""

from __future__ import annotations

import gtsam
import numpy as np

from wiclosure.types import FloatArray

ROWS, LENGTH = 4, 15
FIRST = LENGTH * np.arange(ROWS**2 + 1)


def plan() -> gtsam.GaussianFactorGraph:
    """Chains of which each has three links to the next one in its row and its column."""
    rng = np.random.default_rng(5)
    graph = gtsam.GaussianFactorGraph()

    def add(*keys: int) -> None:
        parts = [part for key in keys for part in (key, 2 * np.eye(6) + 0.3 * rng.normal(size=(6, 6)))]
        graph.add(gtsam.JacobianFactor(*parts, rng.normal(size=6), gtsam.noiseModel.Unit.Create(6)))

    for chain, first in enumerate(FIRST[:-1].tolist()):
        add(first)
        for key in range(first, first + LENGTH - 1):
            add(key, key + 1)
        for other in (chain + 1, chain + ROWS):
            if other < ROWS**2 and (other == chain + ROWS or other % ROWS):
                for at, beside in rng.integers(LENGTH, size=(3, 2)).tolist():
                    add(first + at, int(FIRST[other]) + beside)
    return graph


def inverse(graph: gtsam.GaussianFactorGraph) -> FloatArray:
    """`(K, 6, K, 6)` of the information of poses 0 to K - 1."""
    poses = graph.keys().size()
    ordering = gtsam.Ordering()
    for key in range(poses):
        ordering.push_back(key)
    return np.asarray(np.linalg.inv(graph.hessian(ordering)[0]).reshape(poses, 6, poses, 6))
