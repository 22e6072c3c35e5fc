from __future__ import annotations

import time

import pytest

from wiclosure.pipeline.runtime.stopwatch import Stopwatch


def test_times_of_one_stage_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([10.0, 12.5, 20.0, 20.25, 30.0, 31.0])
    monkeypatch.setattr(time, "perf_counter", lambda: next(clock))
    took = Stopwatch()
    for stage in ("matching", "mapping", "matching"):
        with took.time(stage):
            pass
    assert (took["matching"], took["mapping"]) == (3.5, 0.25)


def test_a_stage_that_fails_is_timed_and_one_that_never_ran_is_unknown() -> None:
    took = Stopwatch()
    with pytest.raises(ValueError, match="broken"), took.time("mapping"):
        raise ValueError("broken")
    assert took["mapping"] >= 0
    with pytest.raises(KeyError):
        took["matching"]
