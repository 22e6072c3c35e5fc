"""A whole run on a recorded street with ranges whose truth is 4 % shorter than LiDAR odometry: all closures stay."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))

import mutual

from wiclosure.formats.radio.wireless_log import read_wireless_log
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.run import candidate_filter, prepare, run_stages
from wiclosure.types import WirelessLog


@pytest.mark.slow
def test_ranges_that_odometry_contradicts_cost_no_closure(data_dir: Path, tmp_path: Path) -> None:
    case = data_dir.parent / "cases" / "14-range-only-street"
    if not (case.is_dir() and mutual.RECORDED.is_file()):
        pytest.skip("the recorded street is not here")
    inputs = mutual.recorded(1)
    log = read_wireless_log(case / "radio.jsonl")
    # The log counts from 1.7e9 s, the recording from its own date; both begin 0.1 s before alpha's first scan.
    later_ns = next(iter(inputs.robots[0].scans)).stamp_ns - 1_700_000_000_099_997_512
    moved = tuple(replace(m, stamp_ns=m.stamp_ns + later_ns) for m in log.measurements)
    inputs, config = replace(inputs, wireless=WirelessLog(moved)), mutual.configured(correct=False)
    prepared = prepare(inputs, config, cache=StageCache(tmp_path), jobs=1, progress=NoProgress())
    result = run_stages(prepared, candidate_filter("wiclosure", inputs, config), progress=NoProgress())
    outcome = mutual.Outcome.of(result, 0.0)
    assert outcome.connected == 2
    assert (outcome.accepted, outcome.false) == (12, 0)
