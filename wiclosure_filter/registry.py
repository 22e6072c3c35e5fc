"""All candidate filters by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from wiclosure.errors import ConfigError
from wiclosure.interfaces import CandidateFilter
from wiclosure.suggestions import did_you_mean
from wiclosure.types import Trajectory
from wiclosure.wiclosure_filter.baselines import NoFilter, OracleFilter, RandomFilter, RangeGateFilter
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.workers import Workers

GroundTruth: TypeAlias = Mapping[str, Trajectory]
FilterFactory: TypeAlias = Callable[[FilterSettings, GroundTruth | None, Workers | None], CandidateFilter]
_Truth: TypeAlias = GroundTruth | None
_Pool: TypeAlias = Workers | None


def _make_none(settings: FilterSettings, ground_truth: _Truth, workers: _Pool) -> CandidateFilter:
    return NoFilter()


def _make_random(
    settings: FilterSettings, ground_truth: GroundTruth | None, workers: Workers | None
) -> CandidateFilter:
    return RandomFilter(settings.random.keep_rate, settings.random.seed)


def _make_oracle(
    settings: FilterSettings, ground_truth: GroundTruth | None, workers: Workers | None
) -> CandidateFilter:
    if ground_truth is None:
        raise ConfigError("the oracle filter needs ground truth; give a ground_truth trajectory for every robot")
    return OracleFilter(ground_truth, settings.oracle.radius_m)


def _make_range_gate(
    settings: FilterSettings, ground_truth: GroundTruth | None, workers: Workers | None
) -> CandidateFilter:
    return RangeGateFilter(settings.range_gate.max_range_m, settings.range_gate.window_m)


def _make_wiclosure(
    settings: FilterSettings, ground_truth: GroundTruth | None, workers: Workers | None
) -> CandidateFilter:
    # GTSAM takes half a second to import: the other filters do without.
    from wiclosure.wiclosure_filter.filter import WiClosureFilter

    return WiClosureFilter(settings, workers)


FILTERS: dict[str, FilterFactory] = {
    "wiclosure": _make_wiclosure,
    "none": _make_none,
    "random": _make_random,
    "oracle": _make_oracle,
    "range-gate": _make_range_gate,
}


def make_filter(
    name: str,
    settings: FilterSettings | None = None,
    ground_truth: GroundTruth | None = None,
    workers: Workers | None = None,
) -> CandidateFilter:
    """The filter of that name.

    Args:
        name: a key of `FILTERS`.
        settings: defaults where None.
        ground_truth: true trajectories by robot, in one frame; only the oracle needs them.
        workers: who does the work where that is worth it.

    Raises:
        ConfigError: no such filter, or the oracle without ground truth.
    """
    if name not in FILTERS:
        hint = did_you_mean(name, FILTERS)
        raise ConfigError(f"there is no candidate filter {name!r}; {hint}choose one of {', '.join(FILTERS)}")
    return FILTERS[name](settings or FilterSettings(), ground_truth, workers)
