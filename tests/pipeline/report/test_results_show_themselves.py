"""Results of a run, a filter and a back end as a notebook shows them."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO

import numpy as np
import pytest

from wiclosure.pipeline.stages.run_result import RunResult


def test_a_run_shows_its_figures(run_of: Callable[..., RunResult], lost_run: RunResult) -> None:
    run = run_of()
    shown = run._repr_html_()
    assert "alpha and beta" in shown
    assert f"{run.metrics['closures']['accepted']} of {run.metrics['closures']['proposed']} accepted" in shown
    assert "not connected" not in shown
    assert "not connected" in lost_run._repr_html_()
    assert "ambiguous" in lost_run.solution.filtered._repr_html_()
    assert "accepted" in lost_run.solution.graph._repr_html_()


def test_a_run_draws_its_map(run_of: Callable[..., RunResult], lost_run: RunResult) -> None:
    run = run_of()
    (axes,) = run.plot().axes
    assert len(axes.collections[0].get_offsets()) == len(run.merged_map)
    assert axes.get_title() == f"{len(run.solution.graph.accepted)} closures"
    assert len(lost_run.plot().axes) == 2  # the robot that nothing connects is not left out
    run.solution.filtered.plot().savefig(BytesIO(), format="png")


def test_frames_have_a_row_for_each_closure_and_pair(run_of: Callable[..., RunResult]) -> None:
    pytest.importorskip("pandas")
    run = run_of()
    closures, pairs = run.to_dataframe(), run.solution.filtered.to_dataframe()
    assert len(closures) == len(run.solution.closures)
    assert int(closures.accepted.sum()) == len(run.solution.graph.accepted)
    assert len(pairs) == run.solution.filtered.pairs_kept
    kept = run.solution.filtered.pairs[0]
    np.testing.assert_array_equal(pairs.index_a, kept.index_a)
    assert set(pairs.robot_b) == {kept.robot_b}
    assert len(run.solution.graph.to_dataframe()) == len(closures)
