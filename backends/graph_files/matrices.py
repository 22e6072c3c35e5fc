"""From stated information matrices to covariances that an estimate can use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wiclosure.backends.graph_files.records import Edge, Remarks
from wiclosure.backends.graph_files.settings import GraphFileSettings
from wiclosure.errors import InputError
from wiclosure.types import FloatArray

LEAST_INFORMATION = 1e-8  # 10 km, 10,000 rad: nothing is known along that axis
MOST_INFORMATION = 1e14  # a tenth of a micrometre: what is more exact than that loses the rest to rounding
HABIT_SHARE = 0.2  # more indefinite or empty matrices than this are a habit of the writer, no accident
HABIT_COUNT = 3
TOO_LARGE = 1e30  # of an information: no sensor's
NO_NUMBERS = "its information matrix is not finite"
INDEFINITE = "its information matrix is not positive semi-definite"


@dataclass(frozen=True, eq=False)
class Covariances:
    """What the edges state.

    Args:
        matrices: `(E, 6, 6)`, rotation first.
        defects: why each edge cannot be used; empty if it can.
    """

    matrices: FloatArray
    defects: list[str]


def covariances(edges: Sequence[Edge], settings: GraphFileSettings, remarks: Remarks) -> Covariances:
    """Covariances of all edges; `remarks` get what was assumed or repaired.

    Raises:
        InputError: too many matrices are indefinite, and the settings say to refuse those.
    """
    if not edges:
        return Covariances(np.zeros((0, 6, 6)), [])
    information, defects = _stated(edges, settings, remarks), [edge.defect for edge in edges]
    sensible = np.asarray((np.abs(np.nan_to_num(information, nan=np.inf)) < TOO_LARGE).all(axis=(1, 2)))
    information[~sensible] = np.eye(6)
    eigenvalues, axes = np.linalg.eigh(information)
    indefinite = eigenvalues[:, 0] < -1e-9 * np.maximum(eigenvalues[:, -1], 1.0)
    if settings.indefinite == "refuse":
        _refuse_habit(edges, indefinite)
    else:
        _tell(
            edges, indefinite, "the information matrix is indefinite; its negative axes are taken as unknown", remarks
        )
    singular = (eigenvalues[:, 0] < LEAST_INFORMATION) & ~indefinite
    _tell(edges, singular, "the information matrix is singular; the axis without is taken as unknown", remarks)
    exact = eigenvalues[:, -1] > MOST_INFORMATION
    _tell(edges, exact, f"the information is more than {MOST_INFORMATION:g}; that is used", remarks)
    variances = 1.0 / np.clip(eigenvalues, LEAST_INFORMATION, MOST_INFORMATION)
    refused = indefinite if settings.indefinite == "refuse" else np.zeros(len(edges), bool)
    defects = [
        defect or (NO_NUMBERS if not fine else INDEFINITE if bad else "")
        for defect, fine, bad in zip(defects, sensible, refused, strict=True)
    ]
    return Covariances((axes * variances[:, None, :]) @ np.swapaxes(axes, 1, 2), defects)


def _stated(edges: Sequence[Edge], settings: GraphFileSettings, remarks: Remarks) -> FloatArray:
    """Information `(E, 6, 6)`, that of the settings where none is stated."""
    assumed = np.diag(np.repeat([settings.sigma_rad, settings.sigma_m], 3) ** -2.0)
    stated = np.stack([np.zeros((6, 6)) if edge.information is None else edge.information for edge in edges])
    without = np.array([edge.information is None for edge in edges])
    zero = ~without & ~stated.any(axis=(1, 2))
    if _is_habit(int(zero.sum()), edges):  # of a writer that has nothing to state
        without |= zero
    if without.any():
        remarks.add(
            "no information",
            f"{edges[int(np.argmax(without))].place}: {int(without.sum())} of {len(edges)} edges state no information;"
            f" {settings.sigma_m:g} m and {settings.sigma_rad:g} rad are assumed"
            " (--set graphs.sigma_m=..., --set graphs.sigma_rad=...)",
        )
    stated[without] = assumed
    return stated


def _is_habit(count: int, edges: Sequence[Edge]) -> bool:
    return count >= HABIT_COUNT and count > HABIT_SHARE * len(edges)


def _refuse_habit(edges: Sequence[Edge], indefinite: np.ndarray) -> None:
    count = int(indefinite.sum())
    if _is_habit(count, edges):
        raise InputError(
            f"{edges[int(np.argmax(indefinite))].place}: {count} of {len(edges)} information matrices are not positive"
            " semi-definite, this is the first; write them as g2o does (upper triangle, row by row, translation first),"
            " or repair them with --set graphs.indefinite=repair"
        )


def _tell(edges: Sequence[Edge], which: np.ndarray, sentence: str, remarks: Remarks) -> None:
    if which.any():
        remarks.add(sentence, f"{edges[int(np.argmax(which))].place}: {sentence}", int(which.sum()))
