from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.frontends.odometry.deskewing import deskewed
from wiclosure.types import FloatArray

MOTION = np.array([0.01, -0.02, 0.08, 1.5, 0.1, -0.05])  # of a sweep at 15 m/s in a sharp turn


@given(seed=st.integers(0, 1000), first_s=st.floats(-0.2, 0.2), duration_s=st.floats(0.01, 1.0))
def test_points_come_to_where_they_are_seen_from_at_the_end(seed: int, first_s: float, duration_s: float) -> None:
    rng = np.random.default_rng(seed)
    share = np.concatenate([[0.0, 1.0], rng.random(200)])
    still = rng.uniform(-40, 40, (len(share), 3))  # as seen at the end
    T_end_then = se3.exp((share - 1.0)[:, None] * MOTION)
    seen = se3.transform(se3.inverse(T_end_then), still)

    def T_end_at(shares: FloatArray) -> FloatArray:
        return se3.exp((shares - 1.0)[:, None] * MOTION)

    found = deskewed(seen, first_s + duration_s * share, T_end_at)
    assert np.abs(found - still).max() < 1.5e-3
    np.testing.assert_allclose(found[1], still[1], atol=1e-9)
