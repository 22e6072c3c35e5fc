"""The files of a comparison, besides the run folders of its arms."""

from __future__ import annotations

from pathlib import Path

from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.comparison.pictures import draw_errors, draw_funnel
from wiclosure.pipeline.comparison.tables import write_tables
from wiclosure.pipeline.report.html import write_comparison_report


def write_comparison(folder: Path, comparison: Comparison) -> None:
    """Writes tables, pictures and the page of all arms together into an existing folder."""
    write_tables(folder, comparison)
    draw_errors(folder / "ate.png", comparison)
    draw_funnel(folder / "funnel.png", comparison)
    first = comparison.outcomes[0]
    shown = [o for o in comparison.outcomes if (o.seed, o.preset) == (first.seed, first.preset)]
    write_comparison_report(folder, [folder / outcome.folder for outcome in shown])
