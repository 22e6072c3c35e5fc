"""Figures of one run, filter or recording as tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from wiclosure.display import significant
from wiclosure.pipeline.evaluation.metrics import CandidateMetrics, Metrics, RadioMetrics, TrajectoryMetrics
from wiclosure.types import FilterResult

if TYPE_CHECKING:
    from wiclosure.pipeline.data.folders.overview import Entry
    from wiclosure.pipeline.sources.info import CloudInfo, RecordingInfo

UNKNOWN = "-"
LEAST_S = 0.05  # of a stage that is told: below, it reads 0.0


def run_table(metrics: Metrics) -> Table:
    """One run on one screen, stage after stage, and below it what the user should know."""
    table = _two_columns(f"run with filter: {metrics['filter']}")
    if metrics.get("doubts"):
        table.add_row("map", "[bold red]may be wrong[/bold red], since another one fits about as well: see the remarks")
    _add_pairs(table, metrics["pairs_kept"], metrics["pairs_total"])
    for found in (metrics["candidates"], metrics["candidates_registrable"]):
        if found["true"] is not None:
            table.add_row(f"  within {found['radius_m']:g} m", _candidates(found))
    closures = metrics["closures"]
    table.add_row(
        "closures", f"{closures['proposed']} proposed, {closures['verified']} verified, {closures['accepted']} accepted"
    )
    if closures["accepted_true"] is not None:
        table.add_row("  by ground truth", f"{closures['accepted_true']} true, {closures['accepted_false']} false")
    if metrics["radio"]:
        table.add_section()
        for pair, radio in metrics["radio"].items():
            table.add_row(f"radio {escape(pair)}", _radio(radio))
    table.add_section()
    if any(error is not None for error in (*metrics["ate_m"].values(), *metrics["ate_own_m"].values())):
        _add_errors(table, metrics)
        table.add_section()
    seconds = {stage: value for stage, value in metrics["seconds"].items() if value >= LEAST_S or stage == "total"}
    table.add_row("seconds", ", ".join(f"{stage} {value:.1f}" for stage, value in seconds.items()))
    if metrics["bytes_exchanged"] is not None:
        table.add_row("exchanged", f"{metrics['bytes_exchanged'] / 1e6:.2f} MB")
    if metrics["peak_rss_mb"] is not None:
        table.add_row("peak memory", f"{metrics['peak_rss_mb']:.0f} MB (the largest process)")
    _add_remarks(table, metrics["diagnosis"])
    return table


def trajectory_table(metrics: TrajectoryMetrics) -> Table:
    """Errors of merged trajectories."""
    table = _two_columns("trajectories against ground truth")
    _add_errors(table, metrics)
    _add_remarks(table, metrics["diagnosis"])
    return table


def filter_table(result: FilterResult) -> Table:
    """What a candidate filter kept, and how the radio places the robots."""
    table = _two_columns(f"filter: {result.filter_name}")
    _add_pairs(table, result.pairs_kept, result.pairs_total)
    for pairs in result.pairs:
        table.add_row(f"  {pairs.robot_a}-{pairs.robot_b}", f"{len(pairs):,}")
    for found in result.alignments:
        certainty = "not certain" if found.ambiguous else "certain"
        table.add_row(f"{found.robot_a}-{found.robot_b}", f"alignment {certainty}: {found.reason}")
    table.add_row("seconds", f"{result.seconds:.2f}")
    _add_remarks(table, result.diagnosis)
    return table


def recording_table(found: RecordingInfo) -> Table:
    """What is in a recording."""
    table = _two_columns(escape(str(found.path)))
    table.add_row("kind", found.kind)
    if found.start_ns is not None:
        start = datetime.fromtimestamp(found.start_ns / 1e9, tz=UTC)
        table.add_row("start", f"{start:%Y-%m-%d %H:%M:%S} UTC ({found.start_ns / 1e9:.3f} s)")
    table.add_row("length", f"{found.duration_s:.1f} s, {found.count:,} {'messages' if found.topics else 'scans'}")
    table.add_row("size", f"{found.bytes_on_disk / 1e6:.1f} MB")
    for topic in found.topics:
        table.add_row(escape(topic.name), f"{topic.count:,} x {topic.msgtype}")
        if topic.first_cloud is not None:
            table.add_row("", escape(_cloud(topic.first_cloud)))
    _add_remarks(table, found.notes)
    return table


def overview_table(path: Path, entries: Sequence[Entry]) -> Table:
    """What lies in a folder or data set, and for what a run would use it."""
    table = Table(title=escape(str(path)), title_justify="left", title_style="bold")
    for column in ("path", "what", "used as"):
        table.add_column(column, overflow="fold")
    for entry in entries:
        within = path if path.is_dir() else path.parent
        shown = entry.path.relative_to(within) if entry.path.is_relative_to(within) else entry.path
        table.add_row(escape(str(shown)), escape(entry.what), escape(entry.use) or "[dim]not used[/dim]")
    return table


# -------------------------------------------------------------------------------------------------------------- parts
def _two_columns(title: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", show_header=False)
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    return table


def _add_pairs(table: Table, kept: int, total: int) -> None:
    """A lone robot has none."""
    if total:
        table.add_row("candidate pairs", f"{kept:,} of {total:,} kept ({kept / total:.2%})")


def _add_errors(table: Table, metrics: TrajectoryMetrics) -> None:
    team, horizontal = metrics["ate_m"]["team"], _metres(metrics["ate_horizontal_m"]["team"])
    explained = f"[bold]{_metres(team)}[/bold], {horizontal} without heights (one alignment for all robots)"
    table.add_row("team ATE", UNKNOWN if team is None else explained)
    alone = len(metrics["ate_own_m"]) == 1
    for robot, own in metrics["ate_own_m"].items():
        together = "" if alone else f"{_metres(metrics['ate_m'][robot])} with the team, "
        table.add_row(escape(f"  {robot}"), f"{together}{_metres(own)} aligned on its own")
    for robot, relative in metrics["rpe"].items():
        percent, turned_deg = relative["translation_percent"], relative["rotation_deg"]
        if percent is not None and turned_deg is not None:
            over = f"{significant(percent)} % and {significant(turned_deg)}°"
            table.add_row(escape(f"  {robot} drift"), f"{over} over {relative['distance_m']:g} m")
    for pair, alignment in metrics["alignment"].items():
        metres, degrees = alignment["translation_error_m"], alignment["rotation_error_deg"]
        if metres is not None and degrees is not None:
            table.add_row(
                escape(f"  {pair}"), f"{significant(metres)} m and {significant(degrees)}° off relative to each other"
            )


def _add_remarks(table: Table, sentences: Sequence[str]) -> None:
    if sentences:
        table.add_section()
    for n, sentence in enumerate(sentences):
        table.add_row("remarks" if n == 0 else "", escape(sentence))


def _radio(found: RadioMetrics) -> str:
    """Whether the radio places the robots, how well, and by how many links."""
    said = "alignment certain" if found["certain"] else "alignment not certain, so it prunes nothing"
    if found["yaw_sigma_deg"] is not None:
        said += (
            f"; sigma {significant(found['yaw_sigma_deg'])}° in yaw,"
            f" {_metres(found['horizontal_sigma_m'])} on the ground, {_metres(found['height_sigma_m'])} in height"
        )
    if found["links_used"] is not None:
        said += f"; {found['links_used']} links used"
    return escape(said)


def _candidates(found: CandidateMetrics) -> str:
    if not found["true"]:
        return "no pair, by ground truth"
    recall, precision = _percent(found["recall"]), _percent(found["precision"])
    return f"{recall} of {found['true']:,} true pairs kept, {precision} of kept are true"


def _percent(share: float | None) -> str:
    return UNKNOWN if share is None else f"{share:.1%}"


def _metres(value: float | None) -> str:
    return UNKNOWN if value is None else f"{significant(value)} m"


def _cloud(cloud: CloudInfo) -> str:
    fields = " ".join(field.name for field in cloud.fields)
    times = "" if cloud.times is None else f", times from {cloud.times[0]:.3f} to {cloud.times[1]:.3f} s"
    points = f"{cloud.returns:,} returns in {cloud.height} x {cloud.width} points"
    return f"first cloud: {points}, {cloud.point_step} bytes each: {fields}; frame {cloud.frame_id!r}{times}"
