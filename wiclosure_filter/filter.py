"""Wi-Closure: which keyframes of different robots may see the same place, by their radio measurements."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import TypeAlias

import numpy as np

from wiclosure import se3
from wiclosure.blas import one_blas_thread
from wiclosure.types import (
    CandidatePairs,
    ClosureCheck,
    FilterResult,
    FrameAlignment,
    RadioLinks,
    Trajectory,
    WirelessLog,
    require_own_names,
    robot_pairs,
)
from wiclosure.wiclosure_filter import side_by_side
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.alignment.radio_check import RadioConsistencyCheck
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.faults import witnesses
from wiclosure.wiclosure_filter.faults.cycles import Cycles
from wiclosure.wiclosure_filter.faults.diagnosis import with_fault
from wiclosure.wiclosure_filter.faults.outside import clocks_in_doubt
from wiclosure.wiclosure_filter.faults.reflected import reflections_in_doubt
from wiclosure.wiclosure_filter.faults.team import NameOrders
from wiclosure.wiclosure_filter.faults.who_slipped import Slips
from wiclosure.wiclosure_filter.faults.whole_log import outvoted, without_refuted
from wiclosure.wiclosure_filter.likelihood.frame_prior import FramePrior
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links
from wiclosure.wiclosure_filter.search.gates import make_gate
from wiclosure.wiclosure_filter.search.overlap_search import KeptPairs
from wiclosure.wiclosure_filter.search.pairs import count_pairs
from wiclosure.wiclosure_filter.shared.shared_trajectory import SharedEstimate, SharedTrajectory, share_trajectories
from wiclosure.wiclosure_filter.unjoined.unjoined_robots import UnjoinedRobots, as_candidates, outcome
from wiclosure.workers import ThisProcess, Workers

RobotPair: TypeAlias = tuple[str, str]
NOTHING = KeptPairs.joined([])


class WiClosureFilter:
    """Aligns the robots' frames by radio, shares their trajectories, and keeps the pairs that may overlap.

    Args:
        settings: alignment, shared trajectory, gate, and what to do where the radio cannot tell.
        workers: who aligns and searches where there are many pairs of robots; results are the same for all.
    """

    name = "wiclosure"

    def __init__(self, settings: FilterSettings | None = None, workers: Workers | None = None) -> None:
        self.settings, self.workers = settings or FilterSettings(), workers or ThisProcess()
        self._trajectories: dict[str, Trajectory] = {}
        self._wireless = WirelessLog()

    @one_blas_thread
    def candidates(self, trajectories: Mapping[str, Trajectory], wireless: WirelessLog) -> FilterResult:
        """Kept pairs of all pairs of robots; see `wiclosure.interfaces.CandidateFilter`.

        Raises:
            InputError: robots cannot be joined and `on_ambiguous` is `raise`; too many pairs are kept to list them; or
                a trajectory stands under another robot's name.
        """
        start = perf_counter()
        require_own_names(trajectories)
        # 1. What did the robots measure of each other, and where were they then?
        links = self.gather(trajectories, wireless).by_pair
        # 2. How do the odometry frames lie?  Rejects multipath, and says where the radio cannot tell.
        alignments = self.align(trajectories, links)
        # Where measurements do not fit: is there a systematic error that explains them?
        links, alignments = self.diagnosed(trajectories, wireless, links, alignments)
        # 3. One estimate of all trajectories, with the uncertainty of any two poses.
        shared, alignments = self.shared(trajectories, links, alignments)
        # 4. Where do trajectories overlap?  5. Which pairs there are near enough?
        kept = self.search(shared)
        pairs = tuple(
            kept[pair] if pair in kept else self._unjoined(pair, trajectories, wireless, links, alignments).candidates()
            for pair in robot_pairs(list(trajectories))
        )
        # 6. Where it predicts nothing, the radio can still contradict closures once they are measured.
        predicting = {(used.robot_a, used.robot_b) for used in shared.links}
        unused = [alignment for pair, alignment in alignments.items() if pair not in predicting]
        checks = self._checks(unused, trajectories, links)
        return FilterResult(
            filter_name=self.name,
            pairs=pairs,
            pairs_total=count_pairs(trajectories),
            alignments=_as_predicted(alignments.values(), shared, trajectories),
            diagnosis=(*unknown_robots(trajectories, wireless), *self._explain(pairs, alignments, shared)),
            seconds=perf_counter() - start,
            links=shared.links,
            checks=checks,
        )

    @one_blas_thread
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

    def gather(self, trajectories: Mapping[str, Trajectory], wireless: WirelessLog) -> TeamLinks:
        """The measurements between all robots as arrays."""
        return TeamLinks.of(trajectories, wireless, GatheringLimits.of(self.settings.alignment))

    def align(
        self, trajectories: Mapping[str, Trajectory], links: Mapping[RobotPair, Links]
    ) -> dict[RobotPair, FrameAlignment]:
        """Frame alignments of all pairs of robots that heard each other."""
        return side_by_side.alignments(links, trajectories, self.settings.alignment, self.workers)

    def diagnosed(
        self,
        trajectories: Mapping[str, Trajectory],
        wireless: WirelessLog,
        links: Mapping[RobotPair, Links],
        alignments: Mapping[RobotPair, FrameAlignment],
    ) -> tuple[dict[RobotPair, Links], dict[RobotPair, FrameAlignment]]:
        """Names the likeliest systematic error where measurements do not fit; corrects it if that is accepted."""
        settings, links, alignments = self.settings.alignment, dict(links), dict(alignments)
        cycles = Cycles(alignments, links, trajectories, settings.drift_inflation)
        alignments |= {pair: alignments[pair].doubted(reason) for pair, reason in cycles.contradictions().items()}
        orders = NameOrders.of(alignments, links, trajectories, wireless, settings)
        mixed_up, objection = orders.mixed_up, orders.objection(settings.guard.min_odds)
        alignments |= replace(cycles, alignments=alignments).without_refuted_readings(settings.guard.min_odds)
        if objection:  # which also makes of two robots' few alternatives those of two others
            pruned = [pair for pair, one in alignments.items() if not one.ambiguous or one.likely_alternatives]
            alignments |= {pair: alignments[pair].doubted(objection) for pair in pruned}
        if mixed_up is None:
            faults = side_by_side.faults(alignments.values(), trajectories, wireless, settings, self.workers)
        else:
            faults = dict.fromkeys(alignments, mixed_up)
        alignments |= without_refuted(alignments, links, faults)
        for pair, fault in outvoted(faults, alignments).items():
            alignments[pair] = with_fault(alignments[pair], fault)
            if fault.of_log and self.settings.accept_correction:
                links[pair] = self.gather(*fault.apply((trajectories, wireless))).by_pair[pair]
                corrected = align(links[pair], trajectories, settings)
                alignments[pair] = replace(corrected, corrections=(fault.fault,))
        hidden = reflections_in_doubt(alignments, faults, settings.guard)
        alignments |= {pair: alignments[pair].doubted(reason) for pair, reason in hidden.items()}
        alignments |= Slips(alignments, links, trajectories).told()
        clocks = clocks_in_doubt(alignments, links, trajectories, wireless, settings)
        return links, alignments | {pair: alignments[pair].doubted(reason) for pair, reason in clocks.items()}

    def share(
        self,
        trajectories: Mapping[str, Trajectory],
        links: Mapping[RobotPair, Links],
        alignments: Sequence[FrameAlignment],
    ) -> SharedTrajectory:
        """All robots that the certain ones of the alignments join in one frame."""
        return share_trajectories(trajectories, links, alignments, self._frame_prior, self.settings.shared_trajectory)

    def shared(
        self,
        trajectories: Mapping[str, Trajectory],
        links: Mapping[RobotPair, Links],
        alignments: Mapping[RobotPair, FrameAlignment],
    ) -> tuple[SharedTrajectory, dict[RobotPair, FrameAlignment]]:
        """The same once measurements that it does not rest on were heard, with the alignments that they leave."""
        alignments = dict(alignments)
        while True:
            joined = self.share(trajectories, links, list(alignments.values()))
            refuted = witnesses.refuted(joined, alignments, links, trajectories, self.settings.alignment)
            if not refuted:
                return joined, alignments
            alignments |= {pair: alignments[pair].doubted(reason) for pair, reason in refuted.items()}

    @property
    def _frame_prior(self) -> FramePrior:
        return FramePrior.of(self.settings.alignment, self.settings.shared_trajectory.gravity_sigma_rad)

    def search(self, shared: SharedTrajectory) -> dict[RobotPair, CandidatePairs]:
        """Pairs of keyframes of all robots that the estimates join."""
        gate = make_gate(self.settings.gate)
        near = shared.by_rank(shared.may_meet(gate))
        models = ((pair, shared.estimates[pair].models(*pair, gate)) for pair in near)
        found = dict(side_by_side.searches(models, len(near), self.settings.gate, self.workers))
        budget = self.settings.gate.budget
        return {
            pair: as_candidates(pair, found.get(pair, NOTHING), joint, budget)
            for pair, joint in shared.estimates.items()
        }

    def _unjoined(
        self,
        pair: RobotPair,
        trajectories: Mapping[str, Trajectory],
        wireless: WirelessLog,
        links: Mapping[RobotPair, Links],
        alignments: Mapping[RobotPair, FrameAlignment],
    ) -> UnjoinedRobots:
        both = {robot: trajectories[robot] for robot in pair}
        return UnjoinedRobots(both, wireless, links.get(pair), alignments.get(pair), self.settings, self._frame_prior)

    def _checks(
        self,
        alignments: Sequence[FrameAlignment],
        trajectories: Mapping[str, Trajectory],
        links: Mapping[RobotPair, Links],
    ) -> dict[RobotPair, ClosureCheck]:
        """Radio consistency checks of closures between those robots of which the radio tells anything."""
        max_odds = self.settings.closure_odds
        if max_odds is None:
            return {}
        found = {}
        for alignment in alignments:
            if alignment.suspected_fault:
                continue  # what seems to be wrong contradicts nothing
            pair = (alignment.robot_a, alignment.robot_b)
            check = RadioConsistencyCheck.of(alignment, links[pair], trajectories, self.settings.alignment, max_odds)
            if check is not None:
                found[pair] = check
        return dict(found)

    def _explain(
        self, pairs: Sequence[CandidatePairs], alignments: Mapping[RobotPair, FrameAlignment], shared: SharedTrajectory
    ) -> tuple[str, ...]:
        """Why pairs of robots were not pruned, and which measurements served nothing."""
        sentences, reject = list(shared.diagnosis), self.settings.on_ambiguous == "reject"
        for kept in pairs:
            pair = (kept.robot_a, kept.robot_b)
            alignment = alignments.get(pair)
            reason = "no measurement between the robots" if alignment is None else alignment.reason
            if pair not in shared.estimates:
                sentences.append(f"{pair[0]} and {pair[1]}: {reason}; {outcome(kept, alignment, reject=reject)}")
            elif alignment is not None and alignment.corrections:
                sentences.append(f"{pair[0]} and {pair[1]}: corrected: {'; '.join(alignment.corrections)}")
            elif alignment is not None and alignment.ambiguous:
                sentences.append(f"{pair[0]} and {pair[1]}: {reason}; joined through other robots")
        return tuple(sentences)


def _as_predicted(
    alignments: Iterable[FrameAlignment], shared: SharedTrajectory, trajectories: Mapping[str, Trajectory]
) -> tuple[FrameAlignment, ...]:
    """What the predictions imply at the middle of each meeting, with their covariance; unused ones as they are."""
    links = {(used.robot_a, used.robot_b): used for used in shared.links}
    found = {(one.robot_a, one.robot_b): one for one in alignments}
    for pair in shared.by_rank(pair for pair in found if pair in links and pair in shared.estimates):
        found[pair] = _at_meeting(found[pair], links[pair], shared.estimates[pair], trajectories)
    return tuple(found.values())


def _at_meeting(
    alignment: FrameAlignment, links: RadioLinks, estimate: SharedEstimate, trajectories: Mapping[str, Trajectory]
) -> FrameAlignment:
    if alignment.best is None:
        return alignment
    pair, middle = (alignment.robot_a, alignment.robot_b), len(links.index_a) // 2
    index_a, index_b = links.index_a[[middle]], links.index_b[[middle]]
    T_a_b, covariance = estimate.relative_poses(pair[0], index_a, pair[1], index_b)
    at_a, at_b = (trajectories[robot].poses[i[0]] for robot, i in zip(pair, (index_a, index_b), strict=True))
    best = replace(alignment.best, T_a_b=at_a @ T_a_b[0] @ se3.inverse(at_b))
    return replace(alignment, best=best, covariance=se3.rotate_covariance(se3.adjoint(at_b), covariance[0]))


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
