"""A run in one sentence, and the numbers that people look for first."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wiclosure.display import listed, significant
from wiclosure.pipeline.evaluation.metrics import Metrics


def run_verdict(metrics: Metrics, steps: Sequence[str], doubts: Sequence[str] = ()) -> dict[str, Any]:
    """Tone (`good`, `warn` or `bad`), sentence, what to do next, and what the run says of itself.

    Args:
        metrics: of the run.
        steps: what to do next; empty where nothing is wrong.
        doubts: what else belongs into the sentence, as clauses.
    """
    parts, tone = [_connected(metrics)], "good" if len(metrics["components"]) == 1 else "bad"
    parts += doubts
    if (error_m := metrics["ate_m"].get("team")) is not None:
        parts.append(f"the error against ground truth is {significant(error_m)} m")
    if false := metrics["closures"]["accepted_false"]:
        parts.append(f"{counted_noun(false, 'accepted closure')} {'is' if false == 1 else 'are'} false")
        tone = "bad"
    if steps and tone == "good":
        tone = "warn"
    return {"tone": tone, "sentence": f"{'; '.join(parts)}.", "next": list(steps), "notes": list(metrics["diagnosis"])}


def _connected(metrics: Metrics) -> str:
    components, accepted = metrics["components"], metrics["closures"]["accepted"]
    robots = sum(len(c["robots"]) for c in components)
    if robots == 1:
        return f"One robot, with {counted_noun(accepted, 'loop closure')} within its path"
    if len(components) == 1:
        together = "Both" if robots == 2 else f"All {robots}"
        return f"{together} robots lie in one map, joined by {counted_noun(accepted, 'closure')}"
    groups = "; ".join(listed(c["robots"]) for c in components)
    return f"Not all robots are connected ({groups}): {counted_noun(accepted, 'closure')} accepted"


def counted_noun(number: int, noun: str) -> str:
    """`1 closure`, `2 closures`, `no closures`."""
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"


def headline_numbers(metrics: Metrics) -> list[dict[str, Any]]:
    """The numbers that people look for first."""
    kept, total = metrics["pairs_kept"], metrics["pairs_total"]
    error_m, seconds = metrics["ate_m"].get("team"), metrics["seconds"].get("total")
    closures = metrics["closures"]
    numbers: list[dict[str, Any]] = [
        {
            "label": "error against ground truth (ATE)",
            "value": None if error_m is None else f"{significant(error_m)} m",
            "note": "one alignment for all robots",
        },
        {
            "label": "closures accepted",
            "value": f"{closures['accepted']:,}",
            "note": f"of {closures['proposed']:,} proposed",
        },
        {
            "label": "pairs of keyframes kept",
            "value": f"{significant(100 * kept / total)} %" if total else None,
            "note": f"{kept:,} of {total:,}, filter {metrics['filter']}",
        },
        {
            "label": "time in all",
            "value": None if seconds is None else f"{significant(seconds)} s",
            "note": "from raw scans",
        },
    ]
    return [number for number in numbers if number["value"] is not None]
