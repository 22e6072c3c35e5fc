from __future__ import annotations

import io
from pathlib import Path

from rich.console import Console

from wiclosure.pipeline.report.tables import (
    recording_table,
    run_table,
    trajectory_table,
)
from wiclosure.pipeline.sources.info import CloudInfo, FieldInfo, RecordingInfo, TopicInfo


def metrics_of(name, *, ate, kept, truth=True):
    """`metrics.json` of a small run."""
    known = (lambda value: value) if truth else (lambda _: None)
    candidates = {
        "radius_m": 35.0, "true": known(100), "kept_true": known(90), "precision": known(0.5), "recall": known(0.9),
        "pruned": known(0.8),
    }  # fmt: skip
    return {
        "filter": name,
        "pairs_total": 6400,
        "pairs_kept": kept,
        "candidates": candidates,
        "candidates_registrable": candidates | {"radius_m": 10.0},
        "closures": {
            "proposed": 20, "verified": 10, "accepted": 8, "verified_true": known(9), "verified_false": known(1),
            "accepted_true": known(8), "accepted_false": known(0),
        },
        "ate_m": {"team": ate, "alpha": known(0.25), "beta [2]": known(0.5)},
        "ate_horizontal_m": {"team": ate, "alpha": known(0.25), "beta [2]": known(0.5)},
        "ate_own_m": {"alpha": known(0.125), "beta [2]": known(0.25)},
        "components": [{"robots": ["alpha", "beta [2]"], "ate_m": ate}],
        "rpe": {},
        "alignment": {
            "alpha-beta [2]": {"translation_error_m": known(0.75), "rotation_error_deg": known(0.5), "ambiguous": None}
        },
        "radio": {
            "alpha-beta [2]": {
                "certain": True, "reason": "", "yaw_sigma_deg": 2.25, "horizontal_sigma_m": 0.5, "height_sigma_m": 2.0,
                "measurements_explained": 20, "links_used": 17,
            }
        },
        "seconds": {"filter": 0.5, "matching": 2.0, "total": 30.0},
        "bytes_exchanged": 2_000_000,
        "peak_rss_mb": 512.0,
        "diagnosis": ["alpha and beta: [bold]8 of 10[/bold] closures agree"],
    }  # fmt: skip


def shown(table):
    out = io.StringIO()
    Console(file=out, width=160, color_system=None).print(table)
    return out.getvalue()


def test_a_run_shows_its_figures_and_its_remarks_as_they_are_written():
    text = shown(run_table(metrics_of("wiclosure", ate=0.375, kept=640)))
    for part in (
        "640 of 6,400 kept (10.00%)",
        "90.0% of 100 true pairs kept",
        "8 accepted",
        "8 true, 0 false",
        "0.38 m",
    ):
        assert part in text
    assert "beta [2]" in text
    assert "alignment certain; sigma 2.2° in yaw, 0.50 m on the ground, 2.0 m in height; 17 links used" in text
    assert "[bold]8 of 10[/bold] closures agree" in text
    assert "0.75 m and 0.50°" in text


def test_no_pair_in_the_truth_is_said_so():
    metrics = metrics_of("wiclosure", ate=0.375, kept=640)
    metrics["candidates"] |= {"true": 0, "kept_true": 0, "recall": None, "precision": 0.0}
    text = shown(run_table(metrics))
    assert "no pair, by ground truth" in text
    assert "of 0 true pairs" not in text


def test_a_run_without_ground_truth_has_no_rows_of_errors():
    metrics = metrics_of("none", ate=None, kept=6400, truth=False)
    text = shown(run_table(metrics))
    for row in ("team ATE", "with the team", "within", "by ground truth"):
        assert row not in text
    assert "None" not in text + shown(trajectory_table(metrics))


def test_a_lone_robot_has_no_pairs_and_no_team() -> None:
    metrics = metrics_of("none", ate=0.25, kept=0) | {"pairs_total": 0, "ate_own_m": {"alpha": 0.25}}
    text = shown(run_table(metrics))
    assert "candidate pairs" not in text
    assert "with the team" not in text
    assert "0.25 m aligned on its own" in text


def test_a_recording_shows_topics_and_the_first_cloud():
    cloud = CloudInfo(1, 1000, 990, 16, "lidar", (FieldInfo("x", "f4", 0), FieldInfo("t", "u4", 12)), (0.0, 0.1))
    topics = (
        TopicInfo("/points", "sensor_msgs/msg/PointCloud2", 12, cloud),
        TopicInfo("/imu", "sensor_msgs/msg/Imu", 99),
    )
    found = RecordingInfo(
        Path("run.mcap"), "ROS 2 bag", 1_700_000_000_000_000_000, 12.5, 111, 5_000_000, topics, ("odd",)
    )
    text = shown(recording_table(found))
    for part in (
        "run.mcap",
        "12.5 s, 111 messages",
        "/points",
        "990 returns",
        "x t",
        "2023-11-14 22:13:20",
        "odd",
        "5.0 MB",
    ):
        assert part in text
