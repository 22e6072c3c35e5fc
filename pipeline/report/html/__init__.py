"""The page that a run, a comparison, a filter or an optimisation leaves: one file that needs no network."""

from wiclosure.pipeline.report.html.report import (
    Arm,
    write_again,
    write_comparison_report,
    write_filter_report,
    write_optimisation_report,
    write_run_report,
)

__all__ = [
    "Arm",
    "write_again",
    "write_comparison_report",
    "write_filter_report",
    "write_optimisation_report",
    "write_run_report",
]
