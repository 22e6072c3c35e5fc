from __future__ import annotations

import numpy as np

from wiclosure import Closure, KeyframeId, Measured, RegistrationEvidence, Stage, se3
from wiclosure.display import closure_columns

OPEN = Closure(KeyframeId("alpha", 3), KeyframeId("beta", 5))


def test_a_row_says_what_was_found_and_decided() -> None:
    evidence = RegistrationEvidence(900, 0.8, 0.97, 0.05)
    measured = OPEN.measured_as(Measured(se3.from_yaw(0.0, np.array([1.0, 2.0, 3.0])), np.eye(6), evidence))
    kept = measured.accepted(Stage.ESTIMATE, "agrees")
    lost = OPEN.rejected(Stage.REGISTRATION, "too few points")
    columns = closure_columns([kept, lost])
    assert {len(column) for column in columns.values()} == {2}
    assert columns["query_robot"] == ["alpha", "alpha"]
    assert columns["match_index"] == [5, 5]
    assert columns["accepted"] == [True, False]
    assert columns["rejected_at"] == ["", "registration"]
    assert columns["reason"] == ["agrees", "too few points"]
    assert [columns[axis][0] for axis in ("x_m", "y_m", "z_m")] == [1.0, 2.0, 3.0]
    assert np.isnan(columns["x_m"][1])
    assert columns["inliers"] == [900, 0]


def test_no_closure_is_an_empty_table_with_all_columns() -> None:
    assert set(closure_columns([])) == set(closure_columns([OPEN]))
