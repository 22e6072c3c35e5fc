"""The page that a run, a comparison, a filter or an optimisation leaves: one file that needs no network."""

from wiclosure.pipeline.report.html.page import write_page
from wiclosure.pipeline.report.html.run_data import run_data

__all__ = ["run_data", "write_page"]
