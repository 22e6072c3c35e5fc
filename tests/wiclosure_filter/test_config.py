"""Settings: what the presets change, and what cannot be set."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from wiclosure.pipeline.config import load_config
from wiclosure.wiclosure_filter import FilterSettings


def test_the_papers_filter_is_a_preset_that_changes_four_keys() -> None:
    paper, ours = load_config("paper").filter, FilterSettings()
    assert paper.alignment.multipath == "pcm"
    assert paper.shared_trajectory.method == "shortest"
    assert paper.gate.method == "mahalanobis"
    assert paper.closure_odds is None
    same = {
        "alignment": paper.alignment.model_copy(update={"multipath": ours.alignment.multipath}),
        "shared_trajectory": paper.shared_trajectory.model_copy(update={"method": ours.shared_trajectory.method}),
        "gate": paper.gate.model_copy(update={"method": ours.gate.method}),
        "closure_odds": ours.closure_odds,
    }
    assert paper.model_copy(update=same) == ours


@pytest.mark.parametrize(
    "change",
    [
        {"alignment": {"radio": {"max_paths": 0}}},
        {"alignment": {"radio": {"range_outlier": 0.0}}},  # a single gross error would make every place impossible
        {"alignment": {"radio": {"direct_path_absent": 0.0}}},
        {"gates": {}},
        {"closure_odds": 1.0},
    ],
)
def test_wrong_settings_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        FilterSettings.model_validate(change)
