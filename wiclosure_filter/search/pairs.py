"""Index arrays of keyframe pairs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from wiclosure.errors import InputError
from wiclosure.types import CandidatePairs, IntArray, Trajectory, robot_pairs

# Two int64 indices and the two scores take 32 bytes a pair: 6.4 GB.
MOST_PAIRS = 200_000_000


def all_pairs(robot_a: str, size_a: int, robot_b: str, size_b: int) -> CandidatePairs:
    """Every keyframe of a with every keyframe of b.

    Raises:
        InputError: there are more pairs than can be listed.
    """
    if size_a * size_b > MOST_PAIRS:
        raise InputError(
            f"{robot_a} and {robot_b} have {size_a} and {size_b} keyframes: {size_a * size_b} pairs are too many"
            " to list one by one; give wireless measurements that let the filter choose, or use fewer keyframes"
        )
    index_a = np.repeat(np.arange(size_a, dtype=np.int64), size_b)
    index_b = np.tile(np.arange(size_b, dtype=np.int64), size_a)
    return CandidatePairs.without_prediction(robot_a, robot_b, index_a, index_b)


def count_pairs(trajectories: Mapping[str, Trajectory]) -> int:
    """How many pairs of keyframes there are between different robots."""
    return sum(len(trajectories[a]) * len(trajectories[b]) for a, b in robot_pairs(list(trajectories)))


def from_codes(robot_a: str, robot_b: str, codes: IntArray, size_b: int) -> CandidatePairs:
    """Pairs from sorted unique codes `index_a * size_b + index_b`, of which nothing more is known."""
    index_a, index_b = np.divmod(codes, size_b)
    return CandidatePairs.without_prediction(robot_a, robot_b, index_a, index_b)
