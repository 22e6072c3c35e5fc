"""Figures as tables: for the terminal (rich) and as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Literal

from rich.markup import escape
from rich.table import Table

from wiclosure.pipeline.metrics import CandidateMetrics, Metrics, TrajectoryMetrics
from wiclosure.pipeline.sources.info import CloudInfo, RecordingInfo
from wiclosure.types import FilterResult

UNKNOWN = "-"
Better = Literal["low", "high", None]


def run_table(metrics: Metrics) -> Table:
    """One run on one screen, stage after stage, and below it what the user should know."""
    table = _two_columns(f"run with filter: {metrics['filter']}")
    table.add_row("candidate pairs", _of(metrics["pairs_kept"], metrics["pairs_total"], "kept"))
    for found in (metrics["candidates"], metrics["candidates_registrable"]):
        table.add_row(f"  within {found['radius_m']:g} m", _candidates(found))
    closures = metrics["closures"]
    table.add_row(
        "closures", f"{closures['proposed']} proposed, {closures['verified']} verified, {closures['accepted']} accepted"
    )
    if closures["accepted_true"] is not None:
        table.add_row("  by ground truth", f"{closures['accepted_true']} true, {closures['accepted_false']} false")
    table.add_section()
    _add_errors(table, metrics)
    table.add_section()
    table.add_row("seconds", ", ".join(f"{stage} {value:.1f}" for stage, value in metrics["seconds"].items()))
    if metrics["bytes_exchanged"] is not None:
        table.add_row("exchanged", f"{metrics['bytes_exchanged'] / 1e6:.2f} MB")
    if metrics["peak_rss_mb"] is not None:
        table.add_row("peak memory", f"{metrics['peak_rss_mb']:.0f} MB")
    _add_remarks(table, metrics["diagnosis"])
    return table


def trajectory_table(metrics: TrajectoryMetrics) -> Table:
    """Errors of merged trajectories."""
    table = _two_columns("trajectories against ground truth")
    _add_errors(table, metrics)
    _add_remarks(table, metrics["diagnosis"])
    return table


def comparison_table(arms: Mapping[str, Metrics]) -> Table:
    """All arms side by side, the best of each row in bold."""
    table = Table(title="comparison", title_justify="left", title_style="bold")
    table.add_column("", style="dim")
    for name in arms:
        table.add_column(name, justify="right")
    for label, cells, best in _comparison_rows(arms):
        table.add_row(label, *(f"[bold]{cell}[/bold]" if n in best else cell for n, cell in enumerate(cells)))
    return table


def comparison_markdown(arms: Mapping[str, Metrics]) -> str:
    """The same as a Markdown table."""
    lines = ["| | " + " | ".join(arms) + " |", "|---|" + "---:|" * len(arms)]
    for label, cells, best in _comparison_rows(arms):
        shown = (f"**{cell}**" if n in best else cell for n, cell in enumerate(cells))
        lines.append(f"| {label} | " + " | ".join(shown) + " |")
    return "\n".join(lines) + "\n"


def filter_table(result: FilterResult) -> Table:
    """What a candidate filter kept, and how the radio places the robots."""
    table = _two_columns(f"filter: {result.filter_name}")
    table.add_row("candidate pairs", _of(result.pairs_kept, result.pairs_total, "kept"))
    for pairs in result.pairs:
        table.add_row(f"  {pairs.robot_a}-{pairs.robot_b}", f"{len(pairs):,}")
    for found in result.alignments:
        certain = "not certain" if found.ambiguous else "certain"
        table.add_row(f"{found.robot_a}-{found.robot_b}", f"alignment {certain}: {found.reason}")
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


# ---------------------------------------------------------------------------------------------------------- comparing
def _comparison_rows(arms: Mapping[str, Metrics]) -> list[tuple[str, list[str], set[int]]]:
    """Label, one cell an arm, and which of the cells are best (none where all are)."""
    rows: list[tuple[str, Callable[[Metrics], float | None], str, Better]] = [
        ("pairs kept", lambda m: m["pairs_kept"], "{:,.0f}", None),
        ("  pruned", lambda m: m["candidates"]["pruned"], "{:.1%}", None),
        ("  precision, overlapping", lambda m: m["candidates"]["precision"], "{:.1%}", "high"),
        ("  recall, overlapping", lambda m: m["candidates"]["recall"], "{:.1%}", "high"),
        ("  recall, registrable", lambda m: m["candidates_registrable"]["recall"], "{:.1%}", "high"),
        ("closures proposed", lambda m: m["closures"]["proposed"], "{:.0f}", None),
        ("  verified", lambda m: m["closures"]["verified"], "{:.0f}", None),
        ("  accepted", lambda m: m["closures"]["accepted"], "{:.0f}", None),
        ("  accepted and false", lambda m: m["closures"]["accepted_false"], "{:.0f}", "low"),
        ("team ATE, m", lambda m: m["ate_m"]["team"], "{:.3f}", "low"),
        ("exchanged, MB", lambda m: _megabytes(m["bytes_exchanged"]), "{:.2f}", "low"),
        ("seconds: filter", lambda m: m["seconds"].get("filter"), "{:.2f}", None),
        ("  matching", lambda m: m["seconds"].get("matching"), "{:.2f}", "low"),
        ("  verification", lambda m: m["seconds"].get("verification"), "{:.2f}", "low"),
        ("  optimisation", lambda m: m["seconds"].get("optimisation"), "{:.2f}", "low"),
        ("  total, odometry included", lambda m: m["seconds"].get("total"), "{:.2f}", "low"),
    ]
    found = []
    for label, value_of, form, better in rows:
        values = [value_of(metrics) for metrics in arms.values()]
        cells = [UNKNOWN if value is None else form.format(value) for value in values]
        found.append((label, cells, _best(values, cells, better)))
    return found


def _best(values: Sequence[float | None], cells: Sequence[str], better: Better) -> set[int]:
    """Arms with the best value, as far as the digits shown tell; empty if there is no best or all share it."""
    known = [value for value in values if value is not None]
    if better is None or not known:
        return set()
    best = cells[values.index(min(known) if better == "low" else max(known))]
    chosen = {n for n, cell in enumerate(cells) if cell == best}
    return chosen if len(chosen) < len(cells) else set()


def _megabytes(count: int | None) -> float | None:
    return None if count is None else count / 1e6


# -------------------------------------------------------------------------------------------------------------- parts
def _two_columns(title: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold", show_header=False)
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    return table


def _add_errors(table: Table, metrics: TrajectoryMetrics) -> None:
    team = metrics["ate_m"]["team"]
    table.add_row("team ATE", UNKNOWN if team is None else f"[bold]{team:.3f} m[/bold] (one alignment for all robots)")
    for robot, own in metrics["ate_own_m"].items():
        together = _metres(metrics["ate_m"][robot])
        table.add_row(escape(f"  {robot}"), f"{together} with the team, {_metres(own)} aligned on its own")
    for robot, relative in metrics["rpe"].items():
        if relative["translation_percent"] is not None:
            over = f"{relative['translation_percent']:.2f} % and {relative['rotation_deg']:.2f}°"
            table.add_row(escape(f"  {robot} drift"), f"{over} over {relative['distance_m']:g} m")
    for pair, alignment in metrics["alignment"].items():
        metres, degrees = alignment["translation_error_m"], alignment["rotation_error_deg"]
        if metres is not None and degrees is not None:
            table.add_row(escape(f"  {pair}"), f"{metres:.3f} m and {degrees:.2f}° off relative to each other")


def _add_remarks(table: Table, sentences: Sequence[str]) -> None:
    if sentences:
        table.add_section()
    for n, sentence in enumerate(sentences):
        table.add_row("remarks" if n == 0 else "", escape(sentence))


def _candidates(found: CandidateMetrics) -> str:
    if found["true"] is None:
        return UNKNOWN
    recall, precision = _percent(found["recall"]), _percent(found["precision"])
    return f"{recall} of {found['true']:,} true pairs kept, {precision} of kept are true"


def _of(part: int, whole: int, word: str) -> str:
    share = f" ({part / whole:.2%})" if whole else ""
    return f"{part:,} of {whole:,} {word}{share}"


def _percent(share: float | None) -> str:
    return UNKNOWN if share is None else f"{share:.1%}"


def _metres(value: float | None) -> str:
    return UNKNOWN if value is None else f"{value:.3f} m"


def _cloud(cloud: CloudInfo) -> str:
    fields = " ".join(field.name for field in cloud.fields)
    times = "" if cloud.times is None else f", times from {cloud.times[0]:.3f} to {cloud.times[1]:.3f} s"
    points = f"{cloud.returns:,} returns in {cloud.height} x {cloud.width} points"
    return f"first cloud: {points}, {cloud.point_step} bytes each: {fields}; frame {cloud.frame_id!r}{times}"
