"""Where least squares starts: rotations relaxed to matrices, then positions, each by one linear solution."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from wiclosure import se3
from wiclosure.backends.least_squares.system import System, whiteners
from wiclosure.types import FloatArray, IntArray


def chordal(system: System, poses: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """Node poses `(N, 4, 4)` by chordal relaxation (Carlone et al., ICRA 2015), those held as in `poses`.

    Rotations first, `R_second = R_first R_measured` without regard to orthogonality, each edge weighted by its
    information on rotation; then positions, `R_first^T (t_second - t_first) = t_measured`, by that on translation.
    Edges count by the weights `(M,)` besides.
    """
    edges, normal, w = system.edges, system.normal, _full(system) if weights is None else weights
    W = np.sqrt(3.0 / np.trace(edges.covariance[:, :3, :3], axis1=1, axis2=2))[:, None, None] * np.eye(3)
    # Transposed, rows become columns: the same derivatives for all three of them.
    A, B = -W @ np.swapaxes(edges.T[:, :3, :3], 1, 2), W
    of_world = np.swapaxes(poses[:, :3, :3], 1, 2)
    gradient = system.gradient((A, B), w[:, None, None] * (A @ of_world[edges.first] + B @ of_world[edges.second]))
    relaxed = of_world + normal.factorised(A, B, w, system.held, 0.0).solve(-gradient)
    R = _nearest_rotations(np.swapaxes(relaxed, 1, 2))
    t = poses[:, :3, 3]
    B = whiteners(edges.covariance[:, 3:, 3:]) @ np.swapaxes(R[edges.second], 1, 2)
    apart = t[edges.second] - t[edges.first] - (R[edges.first] @ edges.T[:, :3, 3, None])[..., 0]
    gradient = system.gradient((-B, B), w[:, None] * (B @ apart[..., None])[..., 0])
    return se3.from_rotation_translation(R, t + normal.factorised(-B, B, w, system.held, 0.0).solve(-gradient))


def cheaper_start(system: System, poses: FloatArray) -> FloatArray:
    """The poses given or chordal initialisation, whichever costs less, of each connected part of the graph.

    Or those given, where no part costs more by them than true poses are expected to: no start is better.
    """
    parts, part = _parts(system)
    of_edges = part[system.edges.first]
    expected = len(system.compared) * np.bincount(of_edges, minlength=parts)
    if (np.bincount(of_edges, system.chi_squares(poses), parts) <= expected).all():
        return poses
    return cheaper(system, poses, chordal(system, poses))


def cheaper(system: System, poses: FloatArray, others: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """Of two sets of poses `(N, 4, 4)`, those that cost less, in each connected part of the graph by itself.

    Edges count by the weights `(M,)`.
    """
    (parts, part), w = _parts(system), _full(system) if weights is None else weights
    costs = [np.bincount(part[system.edges.first], w * system.chi_squares(of), parts) for of in (poses, others)]
    return np.where((costs[1] < costs[0])[part][:, None, None], others, poses)


def _full(system: System) -> FloatArray:
    return np.ones(len(system.edges))


def _parts(system: System) -> tuple[int, IntArray]:
    """How many connected parts the graph has, and that of each node `(N,)`."""
    first, second = system.edges.first, system.edges.second
    joined = sp.coo_matrix((np.ones(len(first)), (first, second)), shape=(system.size, system.size))
    parts, part = connected_components(joined, directed=False)
    return int(parts), part.astype(np.int64)


def _nearest_rotations(M: FloatArray) -> FloatArray:
    """To matrices `(N, 3, 3)`, by the sum of squared differences."""
    U, _, Vt = np.linalg.svd(M)
    Vt[:, 2] *= np.linalg.det(U @ Vt)[:, None]
    return np.asarray(U @ Vt)
