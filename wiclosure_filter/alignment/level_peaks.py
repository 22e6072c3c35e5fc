"""Peaks between level frames, the likely ones of which are followed through the drift of odometry."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from wiclosure.types import FrameAlignment
from wiclosure.wiclosure_filter.alignment.ambiguity import Selection, assess
from wiclosure.wiclosure_filter.alignment.chosen_alignment import ChosenAlignment
from wiclosure.wiclosure_filter.alignment.fitting_blunders import FittingBlunders
from wiclosure.wiclosure_filter.alignment.followed import follow, rigid_transform
from wiclosure.wiclosure_filter.alignment.second_alignment import SecondAlignment, second_alignment
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.consensus.consensus import AnchoredPeaks
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem
from wiclosure.wiclosure_filter.drift.drifting_frames import DriftingFrames, RigidTransform
from wiclosure.wiclosure_filter.links.links import Links


@dataclass(frozen=True, eq=False)
class LevelPeaks:
    """Peaks between level frames, of which some are to be followed through the drift.

    Args:
        found: all of them.
        links: the measurements.
        problem: what was known of them.
        selection: which one to use.
        second: a second one that the measurements speak of besides.
        settings: of the alignment.
    """

    found: AnchoredPeaks
    links: Links
    problem: AlignmentProblem
    selection: Selection
    second: SecondAlignment | None
    settings: AlignmentSettings

    @classmethod
    def of(
        cls, found: AnchoredPeaks, links: Links, problem: AlignmentProblem, settings: AlignmentSettings
    ) -> LevelPeaks:
        """Selects among the peaks."""
        selection, second = assess(found.peaks, found.mixture, found.prior, settings.guard), None
        if found.chosen is None and not selection.ambiguous:
            second = second_alignment(
                found, selection.best, selection.different, selection.log_volume, settings.guard.min_odds
            )
        return cls(found, links, problem, selection, second, settings)

    @property
    def rows(self) -> tuple[int, ...]:
        """Of the peaks that may be reported, the best first."""
        chosen = self.selection
        if self.second is not None:
            return chosen.best, self.second.row
        twin = () if chosen.ambiguous or chosen.twin is None else (chosen.twin,)
        return (chosen.best, *chosen.others, *twin)

    @property
    def _drifts(self) -> bool:
        return self.found.chosen is None and len(self.links) > 1

    @property
    def to_follow(self) -> list[RigidTransform]:
        """Those of the same peaks, or none where nothing is to be followed."""
        if not self._drifts:
            return []
        calibration = self.settings.calibration
        return [rigid_transform(self.found, row, self.problem.odometry, calibration) for row in self.rows]

    def alignment(self, frames: Iterator[DriftingFrames | None]) -> FrameAlignment:
        """From the chains that follow `to_follow`, the next ones of `frames`."""
        found, links, selection, guard = self.found, self.links, self.selection, self.settings.guard
        chains = [next(frames) if self._drifts else None for _ in self.rows]
        followed = [
            follow(found, row, links, chain, selection.covariance, guard)
            for row, chain in zip(self.rows, chains, strict=True)
        ]
        blunders = None
        if not selection.ambiguous and guard.weigh_blunders:
            blunders = FittingBlunders.of(followed[0], found, links, self.problem.odometry, guard)
        chosen = ChosenAlignment.of(selection, followed, self.second, self.settings, blunders)
        return chosen.alignment(links, self.problem.heading_knowledge, self.settings)
