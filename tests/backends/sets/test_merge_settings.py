from __future__ import annotations

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from scipy.stats import chi2

from wiclosure.backends.config import PcmSettings
from wiclosure.backends.consistency.pcm import merge_settings
from wiclosure.backends.sets.merge_settings import MergeSettings


def test_defaults_are_those_of_the_users_settings():
    """Two places state them: they may not drift apart."""
    assert merge_settings(PcmSettings()) == MergeSettings(agree_limit=float(chi2.ppf(0.99, 6)))


def test_every_setting_comes_from_the_one_of_its_meaning():
    settings = PcmSettings(probability=0.9, ambiguous_share=0.5, min_clique_size=3, max_scale=7.0, view_keyframes=4.0)
    assert merge_settings(settings) == MergeSettings(
        agree_limit=pytest.approx(10.6446, abs=1e-4),
        probability=0.9,
        ambiguous_share=0.5,
        min_size=3,
        most_scale=7.0,
        least_scale=7.0**-3,
        view_steps=4.0,
    )


def test_settings_do_not_change_while_robots_are_merged():
    settings = MergeSettings(agree_limit=16.8)
    with pytest.raises(FrozenInstanceError):
        settings.min_size = 1


def test_what_factors_have_used_up_is_no_longer_allowed():
    after = MergeSettings(agree_limit=16.8, most_scale=10.0, least_scale=1e-3).after(np.array([0.1, 5.0]))
    assert (after.most_scale, after.least_scale) == pytest.approx((2.0, 1e-2))
    assert after.agree_limit == 16.8
