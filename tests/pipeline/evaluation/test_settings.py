from __future__ import annotations

import pytest
from pydantic import ValidationError

from wiclosure.pipeline.evaluation.settings import EvaluationSettings


@pytest.mark.parametrize("name", sorted(EvaluationSettings.model_fields))
def test_every_limit_is_positive(name):
    with pytest.raises(ValidationError, match="greater than 0"):
        EvaluationSettings(**{name: 0.0})
