"""Wi-Closure: which keyframes of different robots may see the same place, by what the radio heard."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np

from wiclosure.errors import InputError
from wiclosure.types import (
    CandidatePairs,
    ClosureCheck,
    FilterResult,
    FrameAlignment,
    PredictionKind,
    Trajectory,
    WirelessLog,
    robot_pairs,
)
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.alignment.odds import AlignmentOdds
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.search.gates import make_gate
from wiclosure.wiclosure_filter.search.overlap_search import KeptPairs, find_overlap
from wiclosure.wiclosure_filter.search.pairs import all_pairs, count_pairs
from wiclosure.wiclosure_filter.search.relative_heading import RelativeHeading
from wiclosure.wiclosure_filter.shared.alternative_estimates import RivalEstimates
from wiclosure.wiclosure_filter.shared.shared_trajectory import SharedEstimate, SharedTrajectory, share_trajectories


class WiClosureFilter:
    """Aligns the robots' frames by radio, shares their trajectories, and keeps the pairs that may overlap.

    Args:
        settings: alignment, shared trajectory, gate, and what to do where the radio cannot tell.
    """

    name = "wiclosure"

    def __init__(self, settings: FilterSettings | None = None) -> None:
        self.settings = settings or FilterSettings()
        self._trajectories: dict[str, Trajectory] = {}
        self._wireless = WirelessLog()

    def candidates(self, trajectories: Mapping[str, Trajectory], wireless: WirelessLog) -> FilterResult:
        """Kept pairs of all pairs of robots; see `wiclosure.interfaces.CandidateFilter`.

        Raises:
            InputError: robots cannot be joined and `on_ambiguous` is `raise`; or more pairs pass than can be listed.
        """
        start = perf_counter()
        # 1. How do the odometry frames lie?  Rejects multipath, and says where the radio cannot tell.
        alignments = self.align(trajectories, wireless)
        # 2. One estimate of all trajectories, with the uncertainty of any two poses.
        shared = share_trajectories(trajectories, wireless, alignments, self.settings)
        # 3. Where do trajectories overlap?  4. Which pairs there are near enough?
        pairs = tuple(
            self._kept(a, b, shared.estimates[a, b])
            if (a, b) in shared.estimates
            else self._unjoined(a, b, trajectories, wireless, alignments)
            for a, b in robot_pairs(list(trajectories))
        )
        # 5. What will the radio say of measured closures that it cannot predict?
        predicting = {(links.robot_a, links.robot_b) for links in shared.links}
        unused = [alignment for alignment in alignments if (alignment.robot_a, alignment.robot_b) not in predicting]
        checks = self._checks(unused, trajectories, wireless)
        diagnosis = (*unknown_robots(trajectories, wireless), *self._explain(pairs, alignments, shared))
        return FilterResult(
            filter_name=self.name,
            pairs=pairs,
            pairs_total=count_pairs(trajectories),
            alignments=alignments,
            diagnosis=diagnosis,
            seconds=perf_counter() - start,
            links=shared.links,
            checks=checks,
        )

    def update(self, new_keyframes: Mapping[str, Trajectory], new_wireless: WirelessLog) -> FilterResult:
        """Takes in what is new since the last call; the pairs of all that is known by now.

        Exactly those of `candidates` on everything at once, and at that cost: a single new measurement may turn an
        alignment, and with it every pair.

        Args:
            new_keyframes: later keyframes of some robots, in the odometry frames of the earlier ones.
            new_wireless: measurements and headings, in any order.

        Raises:
            InputError: as `candidates`, or keyframes that are not later.
        """
        for robot, later in new_keyframes.items():
            earlier = self._trajectories.get(robot)
            self._trajectories[robot] = later if earlier is None else _continued(earlier, later)
        self._wireless = self._wireless + new_wireless
        return self.candidates(self._trajectories, self._wireless)

    def align(self, trajectories: Mapping[str, Trajectory], wireless: WirelessLog) -> tuple[FrameAlignment, ...]:
        """Frame alignments of all pairs of robots that heard each other."""
        heard = {frozenset((m.receiver, m.transmitter)) for m in wireless.measurements}
        return tuple(
            align(a, b, trajectories, wireless, self.settings.alignment)
            for a, b in robot_pairs(list(trajectories))
            if frozenset((a, b)) in heard
        )

    def _kept(self, robot_a: str, robot_b: str, estimate: SharedEstimate) -> CandidatePairs:
        """Pairs that the gate keeps by any of the models, with the scores of the one that suits them best."""
        gate = make_gate(self.settings.gate)
        parts = [find_overlap(model, gate) for model in estimate.models(robot_a, robot_b)]
        kept = KeptPairs.united(parts).best(self.settings.gate.budget)
        return CandidatePairs(
            robot_a, robot_b, kept.index_a, kept.index_b, kept.overlap_probability, kept.mahalanobis, estimate
        )

    def _unjoined(
        self,
        robot_a: str,
        robot_b: str,
        trajectories: Mapping[str, Trajectory],
        wireless: WirelessLog,
        alignments: Sequence[FrameAlignment],
    ) -> CandidatePairs:
        """Where nothing joins the robots for certain: pairs that a few alignments leave, or all, or none."""
        if self.settings.on_ambiguous == "raise":
            raise InputError(
                f"the radio does not tell how {robot_a} and {robot_b} lie; add measurements, or set"
                " on_ambiguous to pass or reject"
            )
        if self.settings.on_ambiguous == "reject":
            none = np.zeros(0, np.int64)
            return CandidatePairs.without_prediction(robot_a, robot_b, none, none)
        own = next((al for al in alignments if (al.robot_a, al.robot_b) == (robot_a, robot_b)), None)
        rivals = None if own is None else RivalEstimates.of(own, trajectories, wireless, self.settings)
        if rivals is not None:
            return self._kept(robot_a, robot_b, rivals)
        whole = all_pairs(robot_a, len(trajectories[robot_a]), robot_b, len(trajectories[robot_b]))
        return whole if own is None else replace(whole, predictor=RelativeHeading.of(own, trajectories, self.settings))

    def _checks(
        self, alignments: Sequence[FrameAlignment], trajectories: Mapping[str, Trajectory], wireless: WirelessLog
    ) -> dict[tuple[str, str], ClosureCheck]:
        """What the radio will say of closures, for the robots of which it says anything."""
        most = self.settings.closure_odds
        if most is None:
            return {}
        found = {
            (al.robot_a, al.robot_b): AlignmentOdds.of(al, trajectories, wireless, self.settings.alignment, most)
            for al in alignments
        }
        return {pair: check for pair, check in found.items() if check is not None}

    def _explain(
        self, pairs: tuple[CandidatePairs, ...], alignments: tuple[FrameAlignment, ...], shared: SharedTrajectory
    ) -> tuple[str, ...]:
        """Why pairs of robots were not pruned, and which measurements served nothing."""
        sentences = list(shared.diagnosis)
        by_pair = {(a.robot_a, a.robot_b): a for a in alignments}
        for kept in pairs:
            pair = (kept.robot_a, kept.robot_b)
            alignment = by_pair.get(pair)
            reason = "no measurement between the robots" if alignment is None else alignment.reason
            if pair not in shared.estimates:
                sentences.append(f"{pair[0]} and {pair[1]}: {reason}; {self._passed(kept, alignment)}")
            elif alignment is not None and alignment.ambiguous:
                sentences.append(f"{pair[0]} and {pair[1]}: {reason}; joined through other robots")
        return tuple(sentences)

    def _passed(self, kept: CandidatePairs, alignment: FrameAlignment | None) -> str:
        """What became of the pairs of robots that nothing joins for certain."""
        if self.settings.on_ambiguous == "reject":
            return "every pair is rejected"
        if alignment is not None and kept.predicts is PredictionKind.POSE:
            likely = 1 + len(alignment.rivals)
            return f"{len(kept)} pairs possible under one of {likely} likely alignments are passed"
        known = "" if kept.predicts is None else ", with the relative heading that compasses tell"
        return f"every pair is passed{known}"


def unknown_robots(trajectories: Mapping[str, Trajectory], wireless: WirelessLog) -> tuple[str, ...]:
    """One sentence on robots in the log that have no trajectory."""
    unknown = sorted(wireless.robots() - set(trajectories))
    if not unknown:
        return ()
    return (f"the wireless log names {', '.join(unknown)}, of which there is no trajectory; left out",)


def _continued(earlier: Trajectory, later: Trajectory) -> Trajectory:
    stamps_ns = np.concatenate([earlier.stamps_ns, later.stamps_ns])
    poses = np.concatenate([earlier.poses, later.poses])
    finer = None
    if earlier.finer is not None or later.finer is not None:
        known, new = earlier.finer or earlier, later.finer or later
        unseen = np.flatnonzero(new.stamps_ns > known.stamps_ns[-1])
        finer = (
            _continued(known, Trajectory(new.robot, new.stamps_ns[unseen], new.poses[unseen])) if len(unseen) else known
        )
    return Trajectory(earlier.robot, stamps_ns, poses, earlier.drift, finer)
