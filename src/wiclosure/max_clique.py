"""Largest set of mutually consistent items: maximum clique by branch and bound over bit sets.

Greedy colouring bounds each branch (Tomita and Seki 2003; bit sets after San Segundo et al. 2011).  Python integers are
the bit sets, so that set algebra on hundreds of vertices is a handful of machine words.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Clique:
    """A set of mutually consistent items.

    Args:
        members: increasing indices.
        proven: true if no larger set exists; false if the time ran out first.
    """

    members: tuple[int, ...]
    proven: bool

    def __len__(self) -> int:
        return len(self.members)


def max_clique(consistent: NDArray[np.bool_], *, time_budget_s: float = 5.0) -> Clique:
    """The maximum clique of a consistency matrix.

    Args:
        consistent: `(N, N)` symmetric; the diagonal is ignored.
        time_budget_s: after this time the best clique so far is returned, `proven` false.

    Raises:
        ValueError: the matrix is not square or not symmetric.
    """
    if consistent.ndim != 2 or consistent.shape[0] != consistent.shape[1]:
        raise ValueError(f"consistency matrix has shape {consistent.shape}; expected (N, N)")
    if not np.array_equal(consistent, consistent.T):
        raise ValueError("consistency matrix is not symmetric")
    order = np.argsort(-consistent.sum(axis=0), kind="stable")  # high degree first: good cliques early
    search = _Search(_bitsets(consistent[np.ix_(order, order)]), time.perf_counter() + time_budget_s)
    search.run()
    return Clique(tuple(sorted(int(order[v]) for v in search.best)), search.proven)


def _bitsets(consistent: NDArray[np.bool_]) -> list[int]:
    """Neighbours of each vertex as an integer, bit v for vertex v."""
    linked = consistent.copy()
    np.fill_diagonal(linked, False)
    packed = np.packbits(linked, axis=1, bitorder="little")
    return [int.from_bytes(row.tobytes(), "little") for row in packed]


class _Search:
    """State of one branch and bound."""

    def __init__(self, neighbours: list[int], deadline: float) -> None:
        self.neighbours = neighbours
        self.deadline = deadline
        self.best: list[int] = []
        self.proven = True

    def run(self) -> None:
        """Grows cliques depth first, highest colour first, on a stack of (candidates, coloured candidates, clique)."""
        everything = (1 << len(self.neighbours)) - 1
        self.best = self._greedy(everything)
        stack: list[tuple[int, list[tuple[int, int]], list[int]]] = (
            [(everything, self._coloured(everything, len(self.best)), [])] if everything else []
        )
        while stack:
            candidates, coloured, clique = stack.pop()
            if not coloured or len(clique) + coloured[-1][1] <= len(self.best):
                continue
            if time.perf_counter() > self.deadline:
                self.proven = False
                return
            vertex, _ = coloured.pop()
            grown = [*clique, vertex]
            if len(grown) > len(self.best):
                self.best = grown
            stack.append((candidates & ~(1 << vertex), coloured, clique))
            inside = candidates & self.neighbours[vertex]
            if inside:
                stack.append((inside, self._coloured(inside, len(self.best) - len(grown)), grown))

    def _greedy(self, candidates: int) -> list[int]:
        """A first clique: always the lowest vertex left, which has the highest degree."""
        clique: list[int] = []
        while candidates:
            clique.append((candidates & -candidates).bit_length() - 1)
            candidates &= self.neighbours[clique[-1]]
        return clique

    def _coloured(self, candidates: int, needed: int) -> list[tuple[int, int]]:
        """Vertices with a colour above `needed`; a colour bounds the clique among its vertex and those before."""
        coloured: list[tuple[int, int]] = []
        colour = 0
        while candidates:
            colour += 1
            independent = candidates
            while independent:
                vertex = (independent & -independent).bit_length() - 1
                candidates &= ~(1 << vertex)
                independent &= ~(1 << vertex) & ~self.neighbours[vertex]
                if colour > needed:
                    coloured.append((vertex, colour))
        return coloured
