"""Radio and closures check each other: where they contradict each other, the loser is dropped for that pair of robots.

The radio's predictions reject registrations one by one, which is right as long as the radio is.  Closures that agree
with each other, and that chance does not explain, are evidence on the frames as well: where hardly anything agrees with
the predictions, look-alike pairs are registered without them, and a set that they make is weighed against the radio.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from wiclosure import se3
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.odds import Agreement, Verdict, agrees_with_radio
from wiclosure.pipeline.mutual_check.pair_check import Pair, PairCheck, PairOutcome, agreeing, ends
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio
from wiclosure.pipeline.mutual_check.refused import judged_by, weigh_refused
from wiclosure.pipeline.mutual_check.rivals.sets import FEWEST
from wiclosure.pipeline.mutual_check.set_evidence import NEAR_M, SetEvidence, places
from wiclosure.types import (
    CandidatePairs,
    Closure,
    PredictionKind,
    Stage,
    Trajectory,
    WirelessLog,
    capped_covariance,
    survivors,
)

RegisterBlindly = Callable[[Pair, Sequence[Closure]], list[Closure]]
"""Registers look-alike pairs of two robots, and the closures given, without any prediction."""


def check_pair(
    outcome: PairOutcome,
    trajectories: Mapping[str, Trajectory],
    wireless: WirelessLog,
    config: Config,
    register_blindly: RegisterBlindly,
) -> PairCheck:
    """Looks for a set of closures that contradicts the radio, and weighs the two.

    Args:
        outcome: of two robots that heard each other.
        trajectories: keyframe odometry of all robots.
        wireless: the whole log.
        config: of the run.
        register_blindly: the second round of registration, which is only asked for where the first is in doubt.
    """
    both = {robot: trajectories[robot] for robot in outcome.pair}
    radio = PairRadio.of(outcome.pair, both, wireless, config.filter.alignment)
    nothing = PairCheck(outcome.pair)
    if radio.measurements == 0:
        return nothing
    refused = weigh_refused(outcome, radio, config)
    found = _Found() if refused else _found(outcome, both, config, register_blindly)
    if len(found.agreeing) < 2:
        return refused or nothing
    if found.gap is not None and not found.gap.contradicts:
        return PairCheck(outcome.pair, None, tuple(c for c in found.blind if c.live))
    # The log is held against odometry without the errors that these closures tell of.
    radio = PairRadio.of(outcome.pair, found.odometry, wireless, config.filter.alignment)
    evidence = SetEvidence.of(found.agreeing, found.others, radio)
    if found.as_predicted and not evidence.claimed.contradicts:
        return nothing
    agrees = found.gap is None and agrees_with_radio(evidence.claimed)
    predicted, refuted = _for_and_against(outcome, config.registration)
    weighed = evidence.weighed_twice(evidence.errors(search=not agrees), config.mutual_check, predicted, refuted)
    if agrees and weighed.verdict is not Verdict.CLOSURES:
        return nothing
    inliers = outcome.live if weighed.verdict is Verdict.RADIO else ()
    lost = ends(found.agreeing) | (ends(outcome.live) - ends(inliers))
    return PairCheck(outcome.pair, weighed, found.blind, lost, _clause(evidence.closures, found.gap))


@dataclass(frozen=True, eq=False)
class _Found:
    """Closures that agree with each other, in spite of the radio.

    Args:
        agreeing: the set.
        odometry: of both robots, as the set has it.
        others: registered closures that contradict it.
        blind: all that were registered without prediction to find it.
        gap: from what is predicted of the set; None where nothing is.
        as_predicted: true where the set is as compasses predict, which tell nothing of ranges and bearings.
    """

    agreeing: Sequence[Closure] = ()
    odometry: Mapping[str, Trajectory] = field(default_factory=dict)
    others: int = 0
    blind: tuple[Closure, ...] = ()
    gap: _Gap | None = None
    as_predicted: bool = False


def _found(
    outcome: PairOutcome, both: Mapping[str, Trajectory], config: Config, register_blindly: RegisterBlindly
) -> _Found:
    """The set that may contradict the radio; nothing where the first round of registration is in no doubt."""
    pools: list[Sequence[Closure]] = [outcome.live, outcome.registered]
    blind: tuple[Closure, ...] = ()
    as_predicted = False
    if outcome.kept.predicts is not None:
        contradicting = _contradicting(outcome.registered, config.registration)
        as_predicted = len(outcome.live) >= max(FEWEST, len(contradicting))
        if as_predicted and outcome.kept.predicts is PredictionKind.POSE:
            return _Found()
        blind = () if as_predicted else tuple(register_blindly(outcome.pair, contradicting))
        pools = [outcome.live if as_predicted else blind]
    for pool in pools:
        judged = pairwise_consistent(pool, both, judged_by(config))
        alike = survivors(judged.closures, Stage.CONSISTENCY)
        if len(alike) > 1:
            others = len(survivors(pool, Stage.REGISTRATION)) - len(alike)
            gap = None if as_predicted else _gap(outcome.kept, alike, config.registration)
            return _Found(alike, judged.restated(both), others, blind, gap, as_predicted)
    return _Found(blind=blind)


def _contradicting(registered: Sequence[Closure], settings: RegistrationSettings) -> list[Closure]:
    """Those that registration would have accepted, had nothing been predicted."""
    limit = stats.chi2.ppf(settings.prior_probability, df=6)
    return [
        closure
        for closure in registered
        if closure.rejected_at is Stage.REGISTRATION
        and (found := closure.evidence) is not None
        and (found.prediction_chi2 or 0.0) > limit
        and found.inlier_ratio >= settings.min_inlier_ratio
        and found.agreement >= settings.min_agreement
    ]


def _for_and_against(outcome: PairOutcome, settings: RegistrationSettings) -> tuple[Agreement, float]:
    """Closures that agree with the predictions, and separate places where no registration found what is predicted."""
    if outcome.kept.predicts is None:
        return Agreement(0, 0, 0.0), 0.0
    live = outcome.live
    predicted = Agreement(len(live), len(_contradicting(outcome.registered, settings)), places(live))
    near = [
        c
        for c in outcome.registered
        if c.prediction is not None
        and c.prediction.kind is PredictionKind.POSE
        and float(np.linalg.norm(c.prediction.T_query_match[:3, 3])) < NEAR_M
    ]
    return predicted, 0.0 if live else places(near)


@dataclass(frozen=True)
class _Gap:
    """How far closures lie from what is predicted of them: medians."""

    metres: float
    degrees: float
    height_m: float
    contradicts: bool

    def __str__(self) -> str:
        height = f", {abs(self.height_m):.1f} m of it in height" if abs(self.height_m) > self.metres / 2 else ""
        return f"{self.metres:.1f} m{height} and {self.degrees:.0f} degrees from where it puts them"


def _gap(kept: CandidatePairs, closures: Sequence[Closure], settings: RegistrationSettings) -> _Gap | None:
    """None where nothing is predicted."""
    if kept.predictor is None:
        return None
    index_a, index_b = np.array([(c.query.index, c.match.index) for c in closures]).T
    predicted, covariance = kept.predictor.relative_poses(kept.robot_a, index_a, kept.robot_b, index_b)
    measured = [c.measured for c in closures if c.measured is not None]
    off = se3.between(predicted, np.stack([m.T_query_match for m in measured]))
    errors = se3.log(off)
    spread = settings.prediction_scale**2 * covariance + np.stack([capped_covariance(m.covariance) for m in measured])
    chi2 = np.einsum("ni,ni->n", errors, np.linalg.solve(spread, errors[..., None])[..., 0])
    return _Gap(
        metres=float(np.median(np.linalg.norm(off[:, :3, 3], axis=1))),
        degrees=float(np.degrees(np.median(se3.rotation_angle(off)))),
        height_m=float(np.median(off[:, 2, 3])),
        contradicts=bool(np.median(chi2) > stats.chi2.ppf(settings.prior_probability, df=6)),
    )


def _clause(closures: Agreement, gap: _Gap | None) -> str:
    return agreeing(closures.agreeing) + ("" if gap is None else f" ({gap})")
