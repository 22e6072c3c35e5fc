from __future__ import annotations

import json

import numpy as np

from wiclosure import se3
from wiclosure.formats.filter_summary import filter_summary
from wiclosure.types import AlignmentHypothesis, CandidatePairs, FilterResult, FrameAlignment


def hypothesis(yaw_rad: float, log_likelihood: float) -> AlignmentHypothesis:
    return AlignmentHypothesis(
        se3.from_yaw(yaw_rad, np.array([1.0, 2.0, 3.0])), log_likelihood, ((0, 2), (np.int64(4), -1))
    )


def test_a_summary_survives_json_with_all_digits():
    best, other = hypothesis(0.1, -1 / 3), hypothesis(2.0, -5.0)
    covariance = np.diag(np.arange(1.0, 7.0) / 7)
    alignment = FrameAlignment(
        "alpha", "beta", best, covariance, True, "two are left", other, "one-way", (other,)
    )  # fmt: skip
    pairs = CandidatePairs.without_prediction("alpha", "beta", np.arange(5), np.arange(5))
    result = FilterResult("wiclosure", (pairs,), 25, (alignment,), ("a sentence",), 0.5)
    read = json.loads(json.dumps(filter_summary(result)))

    assert (read["filter"], read["pairs_kept"], read["pairs_total"]) == ("wiclosure", 5, 25)
    assert (read["diagnosis"], read["seconds"]) == (["a sentence"], 0.5)
    (found,) = read["alignments"]
    np.testing.assert_array_equal(np.reshape(found["T_a_b"], (4, 4)), best.T_a_b)
    np.testing.assert_array_equal(np.reshape(found["covariance"], (6, 6)), covariance)
    assert found["log_likelihood"] == -1 / 3
    assert found["paths_kept"] == [[0, 2], [4, -1]]
    assert found["heading_knowledge"] == "one-way"
    np.testing.assert_array_equal(np.reshape(found["runner_up"]["T_a_b"], (4, 4)), other.T_a_b)
    assert [alternative["log_likelihood"] for alternative in found["rivals"]] == [-5.0]


def test_where_nothing_aligns_there_is_null():
    alignment = FrameAlignment("alpha", "beta", None, None, True, "nothing was heard")
    (found,) = filter_summary(FilterResult("wiclosure", (), 0, (alignment,)))["alignments"]
    assert found["T_a_b"] is found["covariance"] is found["log_likelihood"] is found["runner_up"] is None
    assert found["paths_kept"] == found["rivals"] == []
    assert found["reason"] == "nothing was heard"
