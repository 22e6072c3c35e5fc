"""Positions of bags."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.navigation.gnss_topics import UNKNOWN_SIGMA_M, read_fix_topic

FIX, START_NS = "sensor_msgs/msg/NavSatFix", 1_700_000_000 * 10**9
PLACE = (49.01, 8.42, 115.5)


def at(n):
    return START_NS + n * 10**9


def test_fixes_with_what_they_state(write_bag, fix_message):
    def make(store):
        rows = [
            fix_message(store, at(0), PLACE),
            fix_message(store, at(1), PLACE, status=-1),
            fix_message(store, at(2), (np.nan, 8.4, 1.0)),
            fix_message(store, at(3), (0.0, 0.0, 0.0)),
            fix_message(store, at(4), PLACE, kind=0),
        ]
        return {"/fix": (FIX, [(at(n), row) for n, row in enumerate(rows)])}

    log = read_fix_topic(write_bag(make), "/fix")
    assert log.stamps_ns.tolist() == [at(0), at(4)]
    np.testing.assert_array_equal(log.geodetic, [PLACE, PLACE])
    np.testing.assert_allclose(log.sigma_enu, [[1, 2, 3], UNKNOWN_SIGMA_M])


def test_no_fix_at_all(write_bag, fix_message):
    path = write_bag(lambda store: {"/fix": (FIX, [(at(0), fix_message(store, at(0), PLACE, status=-1))])})
    with pytest.raises(InputError, match="none of 1 messages holds a fix"):
        read_fix_topic(path, "/fix")
    with pytest.raises(InputError, match="topics that have: /fix"):
        read_fix_topic(path, "/gps")


def test_fixes_beyond_the_earth_are_left_out(write_bag, fix_message, caplog):
    odd = {3: (47.0, 8.4, 1e9), 7: (1e4, 8.4, 400.0)}

    def make(store):
        rows = [(at(n), fix_message(store, at(n), odd.get(n, PLACE))) for n in range(50)]
        return {"/fix": (FIX, rows)}

    log = read_fix_topic(write_bag(make), "/fix")
    assert log.stamps_ns.tolist() == [at(n) for n in range(50) if n not in odd]
    assert "2 of 50 fixes lie beyond 90, 360, 100000" in caplog.text
