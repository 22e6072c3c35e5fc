"""Largest set of mutually consistent items: maximum clique by branch and bound over bit sets.

Greedy colouring bounds each branch (Tomita and Seki 2003; weighted after Kumlander 2004; bit sets after San Segundo et
al. 2011).  Python integers are
the bit sets, so that set algebra on hundreds of vertices is a handful of machine words.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from wiclosure.arrays import BoolArray, FloatArray


@dataclass(frozen=True, slots=True)
class Clique:
    """A set of mutually consistent items.

    Args:
        members: increasing indices.
        proven: true if no set of more weight exists; false if the time ran out first.
        weight: of all members together; their number where all weigh the same.
    """

    members: tuple[int, ...]
    proven: bool
    weight: float

    def __len__(self) -> int:
        return len(self.members)


def max_clique(consistent: BoolArray, *, weights: FloatArray | None = None, time_budget_s: float = 5.0) -> Clique:
    """The maximum clique of a consistency matrix.

    Args:
        consistent: `(N, N)` symmetric; the diagonal is ignored.
        weights: `(N,)` positive; the clique of the largest sum is sought. None: the one of most members.
        time_budget_s: after this time the best clique so far is returned, `proven` false.

    Raises:
        ValueError: the matrix is not square or not symmetric, or weights are not positive numbers, one each.
    """
    if consistent.ndim != 2 or consistent.shape[0] != consistent.shape[1]:
        raise ValueError(f"consistency matrix has shape {consistent.shape}; expected (N, N)")
    if not np.array_equal(consistent, consistent.T):
        raise ValueError("consistency matrix is not symmetric")
    weight = np.ones(len(consistent)) if weights is None else np.asarray(weights, float)
    if weight.shape != (len(consistent),) or not (np.isfinite(weight) & (weight > 0)).all():
        raise ValueError(f"weights must be {len(consistent)} positive numbers")
    order = np.argsort(-(consistent @ weight), kind="stable")  # well connected first: good cliques early
    neighbours = _bitsets(consistent[np.ix_(order, order)])
    search = _Search(neighbours, weight[order].tolist(), time.perf_counter() + time_budget_s)
    search.run()
    return Clique(tuple(sorted(int(order[v]) for v in search.best)), search.proven, search.best_weight)


def _bitsets(consistent: BoolArray) -> list[int]:
    """Neighbours of each vertex as an integer, bit v for vertex v."""
    linked = consistent.copy()
    np.fill_diagonal(linked, False)
    packed = np.packbits(linked, axis=1, bitorder="little")
    return [int.from_bytes(row.tobytes(), "little") for row in packed]


class _Search:
    """State of one branch and bound."""

    def __init__(self, neighbours: list[int], weight: list[float], deadline: float) -> None:
        self.neighbours = neighbours
        self.apart = [~(near | 1 << vertex) for vertex, near in enumerate(neighbours)]
        self.weight = weight
        self.alike = len(set(weight)) <= 1
        self.deadline = deadline
        self.best: list[int] = []
        self.best_weight = 0.0
        self.proven = True

    def run(self) -> None:
        """Grows cliques depth first, highest bound first, on a stack of (candidates, bounded candidates, clique)."""
        everything = (1 << len(self.neighbours)) - 1
        self._note(self._greedy(everything))
        stack: list[tuple[int, list[tuple[int, float]], list[int], float]] = (
            [(everything, self._bounded(everything, self.best_weight), [], 0.0)] if everything else []
        )
        while stack:
            candidates, bounded, clique, weight = stack.pop()
            if not bounded or weight + bounded[-1][1] <= self.best_weight:
                continue
            if time.perf_counter() > self.deadline:
                self.proven = False
                return
            vertex, _ = bounded.pop()
            grown, heavier = [*clique, vertex], weight + self.weight[vertex]
            if heavier > self.best_weight:
                self._note(grown)
            stack.append((candidates & ~(1 << vertex), bounded, clique, weight))
            inside = candidates & self.neighbours[vertex]
            if inside:
                stack.append((inside, self._bounded(inside, self.best_weight - heavier), grown, heavier))

    def _note(self, clique: list[int]) -> None:
        self.best, self.best_weight = clique, sum(self.weight[v] for v in clique)

    def _greedy(self, candidates: int) -> list[int]:
        """A first clique: always the lowest vertex left, which is the best connected."""
        clique: list[int] = []
        while candidates:
            clique.append((candidates & -candidates).bit_length() - 1)
            candidates &= self.neighbours[clique[-1]]
        return clique

    def _bounded(self, candidates: int, needed: float) -> list[tuple[int, float]]:
        """Vertices whose bound is above `needed`: the most that a clique among a vertex and those before can weigh.

        Of one colour a clique has one vertex at most: the heaviest of each colour before, and one of its own.
        """
        bounded: list[tuple[int, float]] = []
        before = 0.0
        while candidates:
            colour, coloured, independent = [], 0, candidates
            while independent:
                lowest = independent & -independent
                vertex = lowest.bit_length() - 1
                colour.append(vertex)
                coloured |= lowest
                independent &= self.apart[vertex]
            candidates ^= coloured
            if not self.alike:
                colour.sort(key=self.weight.__getitem__)
            heaviest = before + self.weight[colour[-1]]
            if heaviest > needed:
                bounded += [(v, bound) for v in colour if (bound := before + self.weight[v]) > needed]
            before = heaviest
        return bounded
