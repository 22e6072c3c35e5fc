"""The files of a comparison, besides the run folders of its arms."""

from __future__ import annotations

from pathlib import Path

from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.comparison.pictures import draw_errors, draw_funnel
from wiclosure.pipeline.comparison.tables import write_tables


def write_comparison(folder: Path, comparison: Comparison) -> None:
    """Writes tables and pictures of all arms together into an existing folder."""
    write_tables(folder, comparison)
    draw_errors(folder / "ate.png", comparison)
    draw_funnel(folder / "funnel.png", comparison)
