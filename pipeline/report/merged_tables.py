"""What `wiclosure optimize` found, as tables for the terminal."""

from __future__ import annotations

import numpy as np
from rich.markup import escape
from rich.table import Table

from wiclosure.display import significant
from wiclosure.pipeline.stages.merged_folder import LabelScores, MergedSummary

MANY_ROWS = 40


def merged_tables(found: MergedSummary) -> list[Table]:
    """What was found, and the closures that were rejected."""
    overview = Table(title="optimize", title_justify="left", title_style="bold", show_header=False)
    if found["doubts"]:
        overview.add_row("map", "[bold red]may be wrong[/bold red]: see the remarks")
    overview.add_row("robots", ", ".join(f"{escape(robot)}: {n} poses" for robot, n in found["robots"].items()))
    overview.add_row("closures", f"{found['closures']['accepted']} of {found['closures']['read']} accepted")
    if "labels" in found:
        overview.add_row("  by the file's labels", _scores(found["labels"]))
    overview.add_row("connected", "; ".join(escape(", ".join(group)) for group in found["components"]))
    if found["ignored"]:
        overview.add_row("not used", ", ".join(f"{escape(kind)}: {n}" for kind, n in found["ignored"].items()))
    overview.add_row("seconds", f"{found['seconds']:.1f}")
    overview.add_section()
    for n, sentence in enumerate(found["diagnosis"]):
        overview.add_row("remarks" if n == 0 else "", escape(sentence))
    rejected = found["closures"]["rejected"]
    if not rejected:
        return [overview]
    table = Table("closure", "reason", "m off", "degrees off", title="rejected closures")
    for row in rejected[:MANY_ROWS]:
        metres, radians = row["residual_m"], row["residual_rad"]
        off = ("-", "-") if metres is None else (significant(metres), significant(float(np.degrees(radians))))
        table.add_row(f"{escape(row['first'])} - {escape(row['second'])}", escape(row["reason"]), *off)
    if len(rejected) > MANY_ROWS:
        table.caption = f"and {len(rejected) - MANY_ROWS} more in closures.csv"
    return [overview, table]


def _scores(labels: LabelScores) -> str:
    shares = {"precision": labels["precision"], "recall": labels["recall"]}
    known = [f"{name} {share:.1%}" for name, share in shares.items() if share is not None]
    true = f"{labels['accepted_true']} of {labels['true']} true"
    return ", ".join([true, f"{labels['accepted_false']} of {labels['false']} false", *known])
