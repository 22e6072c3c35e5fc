"""From candidate pairs to proposed closures: which of them look alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.frontends.config import MatchingSettings
from wiclosure.frontends.place_recognition.scan_context import ColumnSpectra, compare_descriptors, ring_keys
from wiclosure.types import (
    CandidatePairs,
    Closure,
    Float32Array,
    FloatArray,
    IntArray,
    KeyframeId,
    Prediction,
    PredictionKind,
    ScanContextMatch,
)

_PAIRS_AT_ONCE = 1 << 18

_ENOUGH = 30  # proposals of two robots that are not thinned further: registered in about a second

# Beyond some metres scan context no longer tells near from far, the prediction does: 10 m count as 0.1 of distance.
_METRES_AS_UNLIKE_AS_CAN_BE = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class MatchResult:
    """What matching made of the candidates of two robots.

    Args:
        closures: proposed, sorted by query (a keyframe of robot_a), then match (of robot_b).
        pairs_in: candidate pairs given.
        pairs_compared: pairs whose ring keys were near enough to compare descriptors.
        pairs_alike: compared pairs under the distance threshold.
        pairs_best: of them, the best of each keyframe.
        pairs_suppressed: of these, left out beside a better one of the same place.
    """

    closures: tuple[Closure, ...]
    pairs_in: int
    pairs_compared: int
    pairs_alike: int
    pairs_best: int
    pairs_suppressed: int


def match(
    pairs: CandidatePairs,
    descriptors_a: Float32Array,
    descriptors_b: Float32Array,
    settings: MatchingSettings,
    shifted_a: Sequence[Float32Array] = (),
) -> MatchResult:
    """Proposes the pairs that look most alike.

    Keyframes of both robots ask: each of robot_a for its best among robot_b's candidates, and each of robot_b likewise.
    A closure's query is always of robot_a.  Where something predicts the pose, the closure has that prediction, a
    looser threshold applies, as the prediction has said already that the places are one, and of pairs that look equally
    alike the one predicted nearer wins.

    Args:
        pairs: candidates, possibly all pairs.
        descriptors_a: `(K_a, rings, sectors)` scan contexts of all keyframes of robot_a.
        descriptors_b: `(K_b, rings, sectors)` those of robot_b.
        settings: thresholds and numbers.
        shifted_a: the same as descriptors_a, of clouds moved sideways: the best of all counts, so that two drives in
            different lanes look alike (Kim et al., "Scan Context++", T-RO 2021).

    Raises:
        InputError: the descriptors differ in shape, or a pair has none.
    """
    _check(pairs, descriptors_a, descriptors_b)
    near = _nearest_by_ring_key(pairs, descriptors_a, descriptors_b, settings)
    a, b = pairs.index_a[near], pairs.index_b[near]
    spectra_b = ColumnSpectra.of(descriptors_b)
    distance, yaw = compare_descriptors(ColumnSpectra.of(descriptors_a), spectra_b, a, b)
    for shifted in shifted_a:
        from_there, yaw_there = compare_descriptors(ColumnSpectra.of(shifted), spectra_b, a, b)
        nearer = from_there < distance
        distance[nearer], yaw[nearer] = from_there[nearer], yaw_there[nearer]
    limit = settings.max_distance if pairs.predicts is None else settings.max_distance_with_prediction
    alike = np.flatnonzero(distance <= limit)
    cost = distance[alike] + _remoteness(pairs, near[alike])
    best = _best_of_each(a[alike], b[alike], cost, settings.candidates_per_keyframe)
    spread = best[_thinned(a[alike[best]], b[alike[best]], cost[best], settings, pairs.predicts)]
    rows = alike[spread]
    closures = _propose(pairs, near[rows], distance[rows], yaw[rows])
    return MatchResult(
        closures,
        pairs_in=len(pairs),
        pairs_compared=len(near),
        pairs_alike=len(alike),
        pairs_best=len(best),
        pairs_suppressed=len(best) - len(spread),
    )


def _thinned(
    index_a: IntArray, index_b: IntArray, cost: FloatArray, settings: MatchingSettings, predicts: PredictionKind | None
) -> IntArray:
    """Rows of the pairs to propose; the few of a short meeting are thinned less, since they need each other."""
    located = predicts is PredictionKind.POSE
    widths = range(settings.suppression_where_located, -1, -1) if located else (settings.suppression,)
    for width in widths:
        kept = spread_out(index_a, index_b, cost, width, settings.budget)
        if len(kept) >= _ENOUGH:
            break
    return kept


def spread_out(index_a: IntArray, index_b: IntArray, cost: FloatArray, width: int, budget: int | None) -> IntArray:
    """Rows, in order, of pairs that are the best within `width` keyframes of both paths (non-maximum suppression).

    One place where two paths run side by side is a diagonal of pairs that all say the same.  Where more than `budget`
    remain, the width is doubled until they fit, so that what is left is spread over all places.
    """
    while True:
        kept = _suppressed(index_a, index_b, cost, width) if width else np.arange(len(cost))
        if budget is None or len(kept) <= budget or width > max(np.ptp(index_a), np.ptp(index_b)):
            return np.sort(kept if budget is None else kept[np.argsort(cost[kept], kind="stable")][:budget])
        width = max(1, 2 * width)


def _suppressed(index_a: IntArray, index_b: IntArray, cost: FloatArray, width: int) -> IntArray:
    """Greedily the cheapest pair, without those near it, and so on: one round for each pair kept."""
    left = np.argsort(cost, kind="stable")
    kept = []
    while len(left):
        first = left[0]
        kept.append(int(first))
        apart = np.maximum(np.abs(index_a[left] - index_a[first]), np.abs(index_b[left] - index_b[first]))
        left = left[apart > width]
    return np.array(kept, np.int64)


def _check(pairs: CandidatePairs, descriptors_a: Float32Array, descriptors_b: Float32Array) -> None:
    if descriptors_a.shape[1:] != descriptors_b.shape[1:]:
        raise InputError(
            f"scan contexts of {pairs.robot_a} are {descriptors_a.shape[1:]}, of {pairs.robot_b}"
            f" {descriptors_b.shape[1:]}; describe both robots with the same settings"
        )
    for robot, index, descriptors in (
        (pairs.robot_a, pairs.index_a, descriptors_a),
        (pairs.robot_b, pairs.index_b, descriptors_b),
    ):
        if len(index) and index.max() >= len(descriptors):
            raise InputError(f"a pair names keyframe {index.max()} of {robot}, which has {len(descriptors)}")


def _nearest_by_ring_key(
    pairs: CandidatePairs, descriptors_a: Float32Array, descriptors_b: Float32Array, settings: MatchingSettings
) -> IntArray:
    """Rows of the pairs that are among the nearest ring keys of either keyframe; all, where none are searched."""
    if settings.ring_key_neighbours is None:
        return np.arange(len(pairs))
    keys_a, keys_b = (ring_keys(d, settings.ring_key) for d in (descriptors_a, descriptors_b))
    distance = np.empty(len(pairs))
    for start in range(0, len(pairs), _PAIRS_AT_ONCE):
        chunk = slice(start, start + _PAIRS_AT_ONCE)
        difference = keys_a[pairs.index_a[chunk]] - keys_b[pairs.index_b[chunk]]
        distance[chunk] = np.einsum("mr,mr->m", difference, difference)
    return _best_of_each(pairs.index_a, pairs.index_b, np.sqrt(distance), settings.ring_key_neighbours)


def _best_of_each(index_a: IntArray, index_b: IntArray, distance: FloatArray, count: int) -> IntArray:
    """Rows, in order, that are among the `count` smallest distances of either of their keyframes."""
    return np.flatnonzero(_ranks(index_a, distance, count) | _ranks(index_b, distance, count))


def _ranks(group: IntArray, distance: FloatArray, count: int) -> NDArray[np.bool_]:
    """Which rows are among the `count` smallest distances of their group."""
    if len(group) == 0:
        return np.zeros(0, bool)
    # One sort by group, then distance: distances scaled below 1 are the fraction of the key.
    order = np.argsort(group + distance / (2.0 * distance.max() + 1e-12), kind="stable")
    sorted_group = group[order]
    starts = np.flatnonzero(np.diff(sorted_group, prepend=sorted_group[0] - 1))
    sizes = np.diff(starts, append=len(group))
    rank = np.arange(len(group)) - np.repeat(starts, sizes)
    among = np.zeros(len(group), bool)
    among[order[rank < count]] = True
    return among


def _remoteness(pairs: CandidatePairs, rows: IntArray) -> FloatArray:
    """What the predicted distance of each pair adds to its scan context distance; 0 where nothing is predicted."""
    predicted = pairs.predicted(rows)
    if predicted is None:
        return np.zeros(len(rows))
    return np.asarray(np.linalg.norm(predicted[0][:, :3, 3], axis=1) / _METRES_AS_UNLIKE_AS_CAN_BE)


def _propose(pairs: CandidatePairs, rows: IntArray, distance: FloatArray, yaw: FloatArray) -> tuple[Closure, ...]:
    predictions = _predictions(pairs, rows)
    source = "odometry" if pairs.robot_a == pairs.robot_b else "radio"
    probability = pairs.overlap_probability[rows].tolist()
    return tuple(
        Closure(
            query=KeyframeId(pairs.robot_a, int(pairs.index_a[row])),
            match=KeyframeId(pairs.robot_b, int(pairs.index_b[row])),
            prediction=predictions[k],
            scan_context=ScanContextMatch(float(distance[k]), float(yaw[k])),
            overlap_probability=None if np.isnan(probability[k]) else probability[k],
            reason="looks alike" if predictions[k] is None else f"predicted by the {source}",
        )
        for k, row in enumerate(rows)
    )


def _predictions(pairs: CandidatePairs, rows: IntArray) -> Sequence[Prediction | None]:
    predicted, kind = pairs.predicted(rows), pairs.predicts
    if predicted is None or kind is None:
        return [None] * len(rows)
    return [Prediction(T, covariance, kind) for T, covariance in zip(*predicted, strict=True)]
