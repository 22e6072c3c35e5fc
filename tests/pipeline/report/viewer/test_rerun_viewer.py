from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from wiclosure.frontends.front_end import Followed
from wiclosure.pipeline.report.viewer import RerunViewer, Window
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import Closure, Stage, survivors

Rows = Callable[[Path], Counter[str]]


def kept(path: Path, run: RunResult) -> Path:
    """A whole run in a file, told stage by stage as the pipeline does."""
    viewer = RerunViewer("a run", file=path)
    viewer.fronts(run.fronts)
    viewer.candidates(run.solution.filtered)
    viewer.closures([Closure(c.query, c.match) for c in run.solution.closures])
    viewer.closures(run.solution.closures)
    viewer.result(run)
    viewer.close()
    return path


@pytest.fixture(scope="module")
def recording(run_of: Callable[..., RunResult], tmp_path_factory: pytest.TempPathFactory) -> tuple[RunResult, Path]:
    run = run_of(("alpha", "beta", "gamma"), keyframes=30)
    return run, kept(tmp_path_factory.mktemp("rrd") / "run.rrd", run)


def test_every_scan_keyframe_and_measurement_is_on_the_timeline(
    recording: tuple[RunResult, Path], rows_of: Rows
) -> None:
    run, path = recording
    rows = rows_of(path)
    for robot in run.fronts:
        assert rows[f"/odometry/{robot}/keyframes"] == rows[f"/map/{robot}/keyframes"] == 30
        assert rows[f"/map/{robot}/body"] == len(run.merged[robot])
        assert rows[f"/map/{robot}/body/scan"] == len(run.fronts[robot].clouds)
    for pair in ("alpha-beta", "beta-gamma"):
        assert rows[f"/radio/{pair}/range/measured"] == rows[f"/radio/{pair}/range/estimate"] == 30
        assert rows[f"/map/links/{pair}"] == 30
    assert "/map/points" in rows
    assert "/diagnosis" in rows


def lines_of(path: Path, entity: str) -> list[np.ndarray]:
    """All lines of an entity `(2, 3)`, of all its rows."""
    found = []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            for name in (name for name in batch.schema.names if name.endswith("strips")):  # none where it is cleared
                found += [np.array(line) for row in batch.column(name).to_pylist() for line in row or ()]
    return found


def test_closures_lie_by_their_fate_between_their_keyframes(recording: tuple[RunResult, Path]) -> None:
    run, path = recording
    accepted = survivors(run.solution.closures, Stage.ESTIMATE)
    ends = np.array(
        [
            [run.solution.graph.trajectories[key.robot].positions[key.index] for key in (c.query, c.match)]
            for c in accepted
        ]
    )
    drawn = np.array(lines_of(path, "/map/closures/accepted"))
    assert drawn.shape == ends.shape
    assert np.abs(np.sort(drawn, axis=0) - np.sort(ends, axis=0)).max() < 1e-4
    rejected = [c for c in run.solution.closures if c.rejected_at is Stage.CONSISTENCY]
    assert len(lines_of(path, "/map/closures/rejected/consistency")) == len(rejected) > 0


def test_candidates_are_thinned_evenly(
    run_of: Callable[..., RunResult], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from wiclosure.pipeline.report.viewer import own_frames

    monkeypatch.setattr(own_frames, "CANDIDATES", 50)
    run = run_of(keyframes=40)
    count = len(lines_of(kept(tmp_path / "run.rrd", run), "/odometry/candidates/alpha-beta"))
    assert 25 <= count <= 50 < run.solution.filtered.pairs_kept


def test_a_robot_that_nothing_connects_is_shown_apart(lost_run: RunResult, tmp_path: Path, rows_of: Rows) -> None:
    rows = rows_of(kept(tmp_path / "run.rrd", lost_run))
    last = list(lost_run.fronts)[-1]
    assert rows[f"/map/{last}/body"] == len(lost_run.merged[last])
    assert not [entity for entity in rows if entity.startswith("/map/links") and last in entity]


def test_a_viewer_that_is_gone_is_told_once_and_harms_nothing(
    run_of: Callable[..., RunResult], tmp_path: Path, rows_of: Rows, caplog: pytest.LogCaptureFixture
) -> None:
    run = run_of(keyframes=20)
    window = Window(page=True)
    viewer = RerunViewer("gone", file=tmp_path / "run.rrd", address=window.address)
    with caplog.at_level(logging.WARNING, logger="wiclosure"):
        viewer.scan("alpha", Followed(10**9, np.eye(4), np.zeros((5, 3), np.float32)))
        viewer.fronts(run.fronts)
        window.close()
        viewer.candidates(run.solution.filtered)
        viewer.result(run)
        viewer.close()
    assert len([r for r in caplog.records if "the run goes on without it" in r.getMessage()]) <= 1
    assert rows_of(tmp_path / "run.rrd")["/map/alpha/body"] == 20  # the file is whole
