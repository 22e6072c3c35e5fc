"""How groups of robots are merged."""

from __future__ import annotations

from dataclasses import dataclass, replace

from wiclosure.types import FloatArray


@dataclass(frozen=True)
class MergeSettings:
    """How to decide.

    Args:
        agree_limit: squared distance within which two closures agree.
        probability: that none of the true closures is taken for an outlier.
        ambiguous_share: a set that contradicts another of the same pair and has this share of its size leaves it open.
        min_size: closures that a set must have.
        most_scale: standard deviations are taken at most so many times as large; 1 takes them as they are.
        least_scale: and at least so many times.
        view_steps: keyframes between scans that still see the same; odometry matches each to the next.
    """

    agree_limit: float
    probability: float = 0.99
    ambiguous_share: float = 0.8
    min_size: int = 2
    most_scale: float = 1.0
    least_scale: float = 1.0
    view_steps: float = 10.0

    def after(self, factors: FloatArray) -> MergeSettings:
        """The same, where standard deviations have been multiplied by these factors already."""
        return replace(
            self, most_scale=self.most_scale / float(factors.max()), least_scale=self.least_scale / float(factors.min())
        )
