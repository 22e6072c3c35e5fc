"""Deskewing: points of a sweep moved to where the sensor saw them from at the sweep's end."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wiclosure.types import FloatArray

_INSTANTS = 2048  # of a sweep, for which poses are computed: at 10 Hz and 15 m/s points err by 0.4 mm at most


def deskewed(points: FloatArray, times: FloatArray, T_end_at: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Points `(N, 3)` in the body's axes at the instant of the last one.

    Poses are computed for some instants, and each point takes the nearest: a fifth of the time that KISS-ICP's own
    deskewing takes, which computes one for each point.

    Args:
        points: each in the body's axes at its own instant.
        times: `(N,)` when each was measured; not all alike.
        T_end_at: takes shares of the sweep `(I,)`, from 0 at the first point to 1 at the last; gives poses
            `(I, 4, 4)` of the body, in its axes at the end.
    """
    first, last = times.min(), times.max()
    nearest = np.rint((times - first) * ((_INSTANTS - 1) / (last - first))).astype(np.intp)
    table = np.ascontiguousarray(T_end_at(np.linspace(0.0, 1.0, _INSTANTS))[:, :3].transpose(1, 2, 0))
    # One number of the matrices after the other: each column of the table stays in the fastest cache, while a matrix
    # for each point would not.
    before, after, part = np.ascontiguousarray(points.T), np.empty((3, len(points))), np.empty(len(points))
    for axis, (*rotation, translation) in enumerate(table):
        np.take(translation, nearest, out=after[axis], mode="clip")
        for entry, coordinate in zip(rotation, before, strict=True):
            np.take(entry, nearest, out=part, mode="clip")
            part *= coordinate
            after[axis] += part
    return np.ascontiguousarray(after.T)
