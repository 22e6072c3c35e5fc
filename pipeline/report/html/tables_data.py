"""All figures of `metrics.json` as tables, for those who read rather than look."""

from __future__ import annotations

from typing import Any

from wiclosure.pipeline.evaluation.metrics import CandidateMetrics, Metrics


def figure_tables(metrics: Metrics) -> list[dict[str, Any]]:
    """Tables with a caption, a header and rows; those without rows are left out."""
    sent = metrics["bytes_exchanged"]
    tables = [
        _candidates(metrics["candidates"], metrics["candidates_registrable"]),
        {
            "caption": "Closures",
            "header": ["", "number"],
            "rows": [[name.replace("_", ", "), count] for name, count in metrics["closures"].items()],
        },
        {
            "caption": "Memory and radio traffic",
            "header": ["", "MB"],
            "rows": [
                ["peak memory of the process", metrics["peak_rss_mb"]],
                ["sent between robots", None if sent is None else sent / 1e6],
            ],
        },
        {
            "caption": "Absolute trajectory error, m: one alignment for all connected robots",
            "header": ["robot", "merged", "without heights", "each robot aligned on its own", "odometry alone"],
            "rows": [
                [
                    robot,
                    error,
                    metrics["ate_horizontal_m"].get(robot),
                    metrics["ate_own_m"].get(robot),
                    metrics["ate_odometry_m"].get(robot),
                ]
                for robot, error in metrics["ate_m"].items()
            ],
        },
        {
            "caption": "Between robots, against ground truth",
            "header": ["robots", "translation error, m", "rotation error, degrees", "radio ambiguous"],
            "rows": [
                [pair, of["translation_error_m"], of["rotation_error_deg"], _yes(of["ambiguous"])]
                for pair, of in metrics["alignment"].items()
            ],
        },
        {
            "caption": "Relative pose error, root mean square",
            "header": [
                "robot",
                "step, m",
                "step, degrees",
                "over, m",
                "translation, m",
                "translation, %",
                "rotation, degrees",
            ],
            "rows": [
                [
                    robot,
                    *(of["step_m"], of["step_deg"], of["distance_m"]),
                    *(of["translation_m"], of["translation_percent"], of["rotation_deg"]),
                ]
                for robot, of in metrics["rpe"].items()
            ],
        },
    ]
    return [table for table in tables if table["rows"]]


def _candidates(overlap: CandidateMetrics, registrable: CandidateMetrics) -> dict[str, Any]:
    names = ("true", "false", "kept_true", "kept_false", "precision", "recall", "false_rejected", "pruned")
    return {
        "caption": "Candidate pairs against ground truth",
        "header": ["", f"within {overlap['radius_m']:g} m", f"within {registrable['radius_m']:g} m"],
        "rows": [[name.replace("_", ", "), overlap.get(name), registrable.get(name)] for name in names],
    }


def _yes(value: bool | None) -> str | None:
    return None if value is None else ("yes" if value else "no")
