from __future__ import annotations

import pytest
from pydantic import ValidationError

from wiclosure.pipeline.evaluation.body_axes import OrientedTruth
from wiclosure.pipeline.evaluation.settings import EvaluationSettings


def test_the_judge_has_the_limits_of_the_settings_and_only_oriented_truth(path):
    truth = {robot: path(seed, robot=robot) for seed, robot in enumerate(("alpha", "beta"))}
    settings = EvaluationSettings(closure_error_m=0.5, closure_error_deg=3.0, ground_truth_gap_s=0.25)
    truth_check = settings.truth_check(truth, OrientedTruth(truth, frozenset({"beta"}), ()))
    assert (truth_check.error_m, truth_check.error_deg, truth_check.gap_s) == (0.5, 3.0, 0.25)
    assert set(truth_check.truth) == {"alpha"}
    assert truth_check.keyframes is truth


@pytest.mark.parametrize("name", sorted(EvaluationSettings.model_fields))
def test_every_limit_is_positive(name):
    with pytest.raises(ValidationError, match="greater than 0"):
        EvaluationSettings(**{name: 0.0})
