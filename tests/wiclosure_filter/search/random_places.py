"""Keyframes where nobody planned them."""

from __future__ import annotations

import numpy as np

from wiclosure.wiclosure_filter.search.pair_model import KeyframePlaces


def random_places(rng: np.random.Generator, size: int, nodes: int, d: int, extent: float) -> KeyframePlaces:
    """A random walk, with keyframes spread over the nodes at random."""
    heading = np.cumsum(rng.normal(0, 0.3, size)) + rng.uniform(0, 6)
    step = rng.choice([0.5, 2.0, 10.0]) * np.stack([np.cos(heading), np.sin(heading), 0.1 * heading], axis=1)[:, :d]
    along = np.sort(rng.choice([0.1, 1.0]) * rng.uniform(0, nodes - 1, size))
    node = along.astype(np.int64)
    own = rng.uniform(-1, 1, (size, d, d))
    return KeyframePlaces(
        positions=np.cumsum(step, axis=0) + rng.uniform(-extent, extent, d),
        own_covariance=rng.choice([0.0, 1e-4, 1.0, 50.0]) * own @ np.swapaxes(own, 1, 2),
        node=node,
        fraction=along - node,
    )


def random_gaussians(seed: int, count: int, d: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Means up to three radii away, standard deviations from a thousandth of the radius to ten radii."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(count, d, d)))[0]
    sigma = radius * 10 ** rng.uniform(-3, 1, (count, d))
    mean = rng.normal(size=(count, d))
    mean *= (radius * rng.uniform(0, 3, count) / np.linalg.norm(mean, axis=1))[:, None]
    return mean, axes * (sigma**2)[:, None, :] @ np.swapaxes(axes, 1, 2)
