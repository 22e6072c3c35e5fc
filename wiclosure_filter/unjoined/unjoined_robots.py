"""Pairs of keyframes of two robots that nothing joins for certain: what the radio still rules out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.errors import InputError
from wiclosure.types import CandidatePairs, FrameAlignment, PredictionKind, Trajectory, WirelessLog
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.faults.cut import Side, sides
from wiclosure.wiclosure_filter.faults.rereading import reread
from wiclosure.wiclosure_filter.likelihood.frame_prior import FramePrior
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits
from wiclosure.wiclosure_filter.links.links import Links
from wiclosure.wiclosure_filter.search.gates import make_gate
from wiclosure.wiclosure_filter.search.overlap_search import KeptPairs, find_overlap
from wiclosure.wiclosure_filter.search.pairs import all_pairs
from wiclosure.wiclosure_filter.search.relative_heading import RelativeHeading, compass_yaw
from wiclosure.wiclosure_filter.shared.alternative_estimates import AlternativeEstimates
from wiclosure.wiclosure_filter.shared.shared_trajectory import SharedEstimate, share_trajectories
from wiclosure.wiclosure_filter.unjoined.part_estimate import PartEstimate


@dataclass(frozen=True, eq=False)
class UnjoinedRobots:
    """Two robots that no certain alignments connect.

    Args:
        trajectories: of both, a first.
        wireless: the log.
        links: what they measured of each other.
        alignment: how they may lie, with what is wrong or in doubt; None where they did not hear each other.
        settings: of the filter.
        prior: on how odometry frames lie to each other.
    """

    trajectories: Mapping[str, Trajectory]
    wireless: WirelessLog
    links: Links | None
    alignment: FrameAlignment | None
    settings: FilterSettings
    prior: FramePrior

    @property
    def pair(self) -> tuple[str, str]:
        """Their names."""
        a, b = self.trajectories
        return a, b

    def candidates(self) -> CandidatePairs:
        """Pairs that a few alignments leave, or all, or none.

        Raises:
            InputError: `on_ambiguous` is `raise`.
        """
        a, b = self.pair
        if self.settings.on_ambiguous == "raise":
            raise InputError(
                f"the radio does not tell how {a} and {b} lie; add measurements, or set on_ambiguous to pass or reject"
            )
        if self.settings.on_ambiguous == "reject":
            none = np.zeros(0, np.int64)
            return CandidatePairs.without_prediction(a, b, none, none)
        estimate = self._estimate()
        if estimate is not None:
            gate = make_gate(self.settings.gate)
            found = KeptPairs.united([find_overlap(model, gate) for model in estimate.models(a, b, gate)])
            return as_candidates(self.pair, found, estimate, self.settings.gate.budget)
        whole = all_pairs(a, len(self.trajectories[a]), b, len(self.trajectories[b]))
        return whole if self.alignment is None else replace(whole, predictor=self._heading())

    def _estimate(self) -> SharedEstimate | None:
        """What the few alignments predict that are likely, or those before and after a slip; None where none do."""
        if self.alignment is None or self.links is None:
            return None
        if self.alignment.slipped:
            return self._cut(self.links, self.alignment)
        return self._alternatives(self.alignment, self.links, self.trajectories)

    def _alternatives(
        self, alignment: FrameAlignment, links: Links, trajectories: Mapping[str, Trajectory]
    ) -> AlternativeEstimates | None:
        limits = GatheringLimits.of(self.settings.alignment)

        def shared(one: FrameAlignment) -> SharedEstimate | None:
            read, own = reread(one, links, trajectories, self.wireless, limits)
            return self._shared(read, own, trajectories)

        return AlternativeEstimates.of(alignment, shared, make_gate(self.settings.gate))

    def _shared(
        self, alignment: FrameAlignment, links: Links, trajectories: Mapping[str, Trajectory]
    ) -> SharedEstimate | None:
        """By an alignment that is taken for certain."""
        settings = self.settings.shared_trajectory
        found = share_trajectories(trajectories, {self.pair: links}, [alignment], self.prior, settings)
        return found.estimates.get(self.pair)

    def _cut(self, links: Links, alignment: FrameAlignment) -> SharedEstimate | None:
        """Links before and after a slip tell one alignment each.

        Where nothing tells who slipped, either robot may have: its trajectory is cut, and each part joined with the
        whole of the other's.  None where one of the alignments is neither certain nor one of a few.
        """
        estimates, slipped = [], (alignment.slipped_robot,) if alignment.slipped_robot else self.pair
        for side in sides(links, alignment, self.trajectories):
            aligned = align(side.links, self.trajectories, self.settings.alignment)
            for robot in slipped:
                found = self._of_part(side, aligned, robot)
                if found is None:
                    return None
                estimates.append(found)
        return AlternativeEstimates(tuple(estimates), make_gate(self.settings.gate))

    def _of_part(self, side: Side, aligned: FrameAlignment, slipped: str) -> PartEstimate | None:
        stretch = side.stretch(slipped, self.trajectories)
        parts = {robot: self.trajectories[robot].subset(np.array(stretch[robot])) for robot in self.pair}
        links = side.links.in_stretch(*(stretch[robot].start for robot in self.pair))
        if aligned.ambiguous:
            estimate: SharedEstimate | None = self._alternatives(aligned, links, parts)
        else:
            estimate = self._shared(aligned, links, parts)
        return None if estimate is None else PartEstimate(estimate, stretch)

    def _heading(self) -> RelativeHeading | None:
        """Rotations that compasses predict where nothing tells positions; None where they are too vague."""
        settings = self.settings
        assert self.alignment is not None  # they heard each other
        yaw = compass_yaw(self.alignment, settings.alignment.guard.max_yaw_sigma_rad)
        if yaw is None or not settings.alignment.gravity_aligned:
            return None
        tilt_sigma_rad, height_sigma_m = self.prior.sigmas[[0, 5]].tolist()
        return RelativeHeading(self.trajectories, *yaw, tilt_sigma_rad, settings.gate.sensor_range_m, height_sigma_m)


def as_candidates(
    pair: tuple[str, str], found: KeptPairs, estimate: SharedEstimate, budget: int | None
) -> CandidatePairs:
    """Pairs that the gate keeps by any of the models, with the scores of the one that suits them best."""
    kept = found.best(budget)
    return CandidatePairs(*pair, kept.index_a, kept.index_b, kept.overlap_probability, kept.mahalanobis, estimate)


def outcome(kept: CandidatePairs, alignment: FrameAlignment | None, *, reject: bool) -> str:
    """Which pairs of two robots are kept that nothing joins for certain, as a clause."""
    if reject:
        return "every pair is rejected"
    if alignment is not None and kept.predicts is PredictionKind.POSE:
        if alignment.slipped:
            return f"{len(kept)} pairs possible by the alignments before or after it are kept"
        likely = 1 + len(alignment.likely_alternatives)
        return f"{len(kept)} pairs possible under one of {likely} likely alignments are kept"
    known = "" if kept.predicts is None else ", with the relative heading from compasses"
    return f"every pair is kept{known}"
