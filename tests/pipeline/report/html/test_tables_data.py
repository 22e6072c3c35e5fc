from __future__ import annotations

from wiclosure.pipeline.report.html.tables_data import arms_table, figure_tables
from wiclosure.pipeline.stages.run_result import RunResult


def metrics_of(ate_m: float | None, closing_s: float, false: int, sent: int | None = 2_000_000) -> dict:
    return {
        "ate_m": {"team": ate_m},
        "components": [{"robots": ["a", "b"]}],
        "pairs_kept": 6192,
        "candidates": {"recall": 0.5},
        "closures": {"proposed": 27, "accepted": 25, "accepted_false": false},
        "seconds": {"filter": 0.5, "verification": closing_s - 0.5, "odometry": 50.0, "total": 50 + closing_s},
        "bytes_exchanged": sent,
    }


def test_differences_from_the_first_arm_with_units() -> None:
    found = arms_table([("none", metrics_of(0.118, 25.0, 4)), ("wiclosure", metrics_of(0.12, 2.5, 0, None))])
    rows = {row[0]: [(cell["text"], cell["note"]) for cell in row[1:]] for row in found["rows"]}
    assert found["header"] == ["", "none", "wiclosure"]
    assert rows["error against ground truth (ATE)"] == [("0.12 m", ""), ("0.12 m", "the same")]
    assert rows["time to find and use closures"] == [("25.0 s", ""), ("2.5 s", "-22.5 s (-90 %)")]
    assert rows["false closures accepted"] == [("4", ""), ("0", "-4 (-100 %)")]
    assert rows["pairs of keyframes kept"] == [("6,192", ""), ("6,192", "the same")]
    assert rows["sent between robots"] == [("2 MB", ""), ("-", "")]


def test_errors_have_two_digits_each_however_far_apart() -> None:
    found = arms_table([("none", metrics_of(8.004, 25.0, 4)), ("wiclosure", metrics_of(0.0361, 2.5, 0))])
    (error,) = (row[1:] for row in found["rows"] if row[0] == "error against ground truth (ATE)")
    assert [cell["text"] for cell in error] == ["8.0 m", "0.036 m"]
    assert error[1]["note"] == "-7.968 m (-100 %)"


def test_an_arm_without_connected_robots_has_no_error() -> None:
    found = arms_table([("none", metrics_of(None, 1.0, 0)), ("wiclosure", metrics_of(0.5, 1.0, 1))])
    rows = {row[0]: [(cell["text"], cell["note"]) for cell in row[1:]] for row in found["rows"]}
    assert rows["error against ground truth (ATE)"] == [("-", ""), ("0.50 m", "")]
    assert rows["false closures accepted"] == [("0", ""), ("1", "+1")]


def test_all_figures_of_a_run(lost_run: RunResult) -> None:
    tables = {table["caption"]: table for table in figure_tables(lost_run.metrics)}
    assert all(len(row) == len(table["header"]) for table in tables.values() for row in table["rows"])
    assert ["accepted", 8] in tables["Closures"]["rows"]
    assert ["sent between robots", 1.5] in tables["Memory and radio traffic"]["rows"]
    (errors,) = (table for caption, table in tables.items() if caption.startswith("Absolute trajectory error"))
    assert [row[0] for row in errors["rows"]] == ["team", "alpha", "beta", "gamma"]
