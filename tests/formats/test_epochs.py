from __future__ import annotations

import numpy as np
import pytest

from wiclosure.formats.epochs import epochs_at, other_epoch

S = 10**9
STAMP_NS = 1_700_000_000 * S  # 14 November 2023, 22:13:20 UTC: a Tuesday, of GPS week 2288


@pytest.mark.parametrize(
    ("name", "stamp_s"),
    [
        ("FILETIME", 13_344_473_600),
        ("NTP", 3_908_988_800),
        ("GPS time", 1_384_035_218),
        ("GPS week", 2 * 86_400 + 80_000 + 18),
        ("day", 80_000),
        (".NET", 63_835_596_800),
    ],
)
def test_known_dates(name: str, stamp_s: int) -> None:
    (epoch,) = (epoch for epoch in epochs_at(STAMP_NS) if name in epoch.name)
    assert STAMP_NS + epoch.before_1970_ns == stamp_s * S
    assert other_epoch(stamp_s * S, (stamp_s + 60) * S, STAMP_NS - 9 * S, STAMP_NS + 100 * S) == epoch


def test_other_times_are_of_no_epoch() -> None:
    for first_s in np.random.default_rng(0).integers(0, 10**7, 20).tolist():
        if min(abs(first_s - of_day) for of_day in (80_000, 252_818)) > 1000:
            assert other_epoch(first_s * S, (first_s + 60) * S, STAMP_NS, STAMP_NS + 100 * S) is None
