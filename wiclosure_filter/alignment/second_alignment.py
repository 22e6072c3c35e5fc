"""A second alignment with support of its own, in what the first one does not explain.

Noise leaves measurements unexplained, but does not make them agree on another alignment.  A *slip* does: what was
measured before it tells one alignment, what was measured after it another.  So does a *reflection that stays*: a wall
shows a virtual transmitter throughout, besides the true one.  Either is told from chance by its Bayes factor: how much
better two alignments explain the measurements than one, against the volume that was searched for the second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray, IntArray
from wiclosure.wiclosure_filter.consensus.consensus import AnchoredPeaks
from wiclosure.wiclosure_filter.drift.strain import SLIP_ODDS, UNLIKELY
from wiclosure.wiclosure_filter.likelihood.mixture import Explanation
from wiclosure.wiclosure_filter.likelihood.residuals import displacements_in_a, seen_by_receiver

_REFLECTION_ODDS = 0.05  # of a wall that shows a virtual transmitter throughout
_EXPLAINED = 0.05  # likelihood of a path, relative to "none is direct", from which an alignment may explain it
_SHARES = np.array([0.1, 0.25, 0.5, 0.9])  # of measurements in which a reflection is seen


@dataclass(frozen=True, eq=False)
class SecondAlignment:
    """Another peak that the measurements speak of besides the best one.

    Args:
        row: of the peak.
        log_odds: natural logarithm of the odds for both against the best one alone.
        sentence: what it is.
        bent_ns: of a slip of the odometry, from when to when it is likely; None of a reflection.
    """

    row: int
    log_odds: float
    sentence: str
    bent_ns: tuple[int, int] | None = None

    @property
    def slip(self) -> bool:
        """Whether it is a slip of the odometry."""
        return self.bent_ns is not None


def second_alignment(
    found: AnchoredPeaks, best: int, different: BoolArray, log_volume: FloatArray, min_odds: float
) -> SecondAlignment | None:
    """The likeliest second alignment, or None where none is beyond chance.

    Args:
        found: N peaks.
        best: row of the alignment.
        different: `(N,)` peaks that are no neighbours of it.
        log_volume: `(N,)` logarithm of each peak's share of the volume that was searched.
        min_odds: from which a second alignment counts.
    """
    rows = np.flatnonzero(different)
    if len(rows) == 0:
        return None
    explanation = _explained(found, np.concatenate([[best], rows]))
    slip = _slip(found, best, rows, explanation, log_volume[rows])
    reflection = _reflection(found, rows, explanation, log_volume[rows])
    likeliest = max((slip, reflection), key=lambda one: one.log_odds)
    return likeliest if likeliest.log_odds > np.log(min_odds) else None


def _explained(found: AnchoredPeaks, rows: IntArray) -> Explanation:
    states, observations = found.peaks.states[rows], found.mixture.observations
    _, w = displacements_in_a(states, observations)
    return found.mixture.explain(seen_by_receiver(w, states[:, :1], ~observations.a_receives))


def _slip(
    found: AnchoredPeaks, best: int, rows: IntArray, explanation: Explanation, log_volume: FloatArray
) -> SecondAlignment:
    """The best time at which the alignment changes from the first to one of the others, or back."""
    observations = found.mixture.observations
    order = np.argsort(observations.stamp_ns, kind="stable")
    gain = ((explanation.log_likelihood[1:] - explanation.log_likelihood[0]) * observations.independence)[:, order]
    before = np.cumsum(gain, axis=1)
    gains = np.stack([before, before[:, -1:] - before])[:, :, :-1]
    if gains.size == 0:
        return SecondAlignment(best, -np.inf, "")
    gains = gains + (log_volume - np.log(gains.shape[2]) + np.log(SLIP_ODDS))[:, None]
    side, which, split = np.unravel_index(int(np.argmax(gains)), gains.shape)
    row = int(rows[which])
    stamps = observations.stamp_ns[order]
    since, until = ((stamps[k] - stamps[0]) / 1e9 for k in (split, split + 1))
    turned = abs(float(se3.wrap_angle(found.peaks.states[row, 0] - found.peaks.states[best, 0])))
    w = displacements_in_a(found.peaks.states[[best, row]], observations)[1][:, order]
    jumped = float(np.linalg.norm((w[1] - w[0])[split, :2]))
    sentence = (
        f"odometry seems to slip, or a robot was moved: measurements until {since:.0f} s after the first tell another"
        f" alignment than those from {until:.0f} s on ({jumped:.1f} m and {np.degrees(turned):.0f} degrees apart)"
    )
    of_time = np.flatnonzero(gains[side, which] >= gains[side, which, split] - np.log(UNLIKELY))
    bent_ns = int(stamps[of_time[0]]), int(stamps[of_time[-1] + 1])
    return SecondAlignment(row, float(gains[side, which, split]), sentence, bent_ns)


def _reflection(
    found: AnchoredPeaks, rows: IntArray, explanation: Explanation, log_volume: FloatArray
) -> SecondAlignment:
    """The peak that is best supported by paths and ranges that the first does not explain."""
    observations = found.mixture.observations
    # Density of the paths if one of them is the second's, relative to chance; without those the first may explain.
    absent = found.mixture.radio.direct_path_absent
    none_direct = np.maximum(1 - explanation.path.sum(axis=-1, keepdims=True), 1e-12)
    likelihood = explanation.path / none_direct
    left = np.where(likelihood[0] > _EXPLAINED, 0.0, likelihood[1:]).sum(axis=-1)
    density = np.where(observations.has_bearing, left * max(absent, 1e-12) / (1 - absent), 1.0)
    ranged = np.isfinite(observations.range_m)
    agrees = np.where(ranged, explanation.in_sight + explanation.obstructed, 0.0)
    density = density / np.maximum(1 - agrees[1:] * (1 - agrees[0]), 1e-6)
    # A path whose length is none that was measured is a reflection, and no transmitter.
    density = np.where(ranged & (agrees[1:] < 0.5), 0.0, density)
    of_share = np.log(1 - _SHARES[:, None, None] + _SHARES[:, None, None] * density)
    # Where it explains the same ranges as the first, only its direction was searched for.
    hits = np.maximum((observations.independence * (density > 1)).sum(axis=-1), 1.0)
    spread = float(np.median(observations.sigma[observations.weight > 0])) if observations.has_bearing.any() else np.pi
    same_ranges = ranged.any() and (agrees[1:] > 0.5)[:, ranged].mean(axis=-1) > 0.8
    volume = np.where(same_ranges, np.log(np.minimum(spread / np.sqrt(2 * np.pi * hits), 1.0)), log_volume)
    gain = (of_share @ observations.independence).max(axis=0) - np.log(len(_SHARES)) + volume + np.log(_REFLECTION_ODDS)
    which = int(np.argmax(gain))
    row = int(rows[which])
    agreeing = int((density[which] > 1).sum())
    sentence = (
        f"{agreeing} of {len(observations)} measurements also hold a path that agrees with another alignment:"
        " one of the two is a reflection"
    )
    return SecondAlignment(row, float(gain[which]), sentence)
