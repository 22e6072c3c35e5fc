"""How the viewer lays a run out at first: the map, each robot's own frame beside it, ranges, the diagnosis."""

from __future__ import annotations

from collections.abc import Iterable

import rerun as rr
import rerun.blueprint as rrb

from wiclosure.pipeline.report.viewer import merged_world, own_frames
from wiclosure.pipeline.report.viewer.columns import TIME


def blueprint(lasting: Iterable[str], *, finished: bool) -> rrb.Blueprint:
    """Map and own frames side by side, ranges and diagnosis below.

    Args:
        lasting: paths of entities whose rows appear one after the other and stay, as closures do.
        finished: whether the run is over; while it goes, the own frames stand in front.
    """
    so_far = rrb.VisibleTimeRanges(
        rr.VisibleTimeRange(
            TIME, start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.cursor_relative(seconds=0.0)
        )
    )
    views = {
        space: rrb.Spatial3DView(
            name=name,
            origin=space,
            overrides={path: [so_far] for path in lasting if path.startswith(f"{space}/")},
        )
        for space, name in ((merged_world.SPACE, "merged map"), (own_frames.SPACE, "each robot in its own frame"))
    }
    below = rrb.Horizontal(
        rrb.TimeSeriesView(name="ranges: measured and by the estimate, m", origin="radio"),
        rrb.TextDocumentView(name="diagnosis", origin="diagnosis"),
    )
    order = [merged_world.SPACE, own_frames.SPACE] if finished else [own_frames.SPACE, merged_world.SPACE]
    above = rrb.Horizontal(*(views[space] for space in order), column_shares=[2, 1])
    return rrb.Blueprint(
        rrb.Vertical(above, below, row_shares=[3, 1]),
        rrb.TimePanel(timeline=TIME, play_state="following"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )
