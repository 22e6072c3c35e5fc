from __future__ import annotations

import logging

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.formats.plausible import few, plausible_path, require_rotation

STAMPS = np.arange(100) * 10**8
STRAIGHT = np.column_stack([np.arange(100.0), np.zeros(100), np.zeros(100)])


def test_a_usual_path_is_kept_without_a_word(caplog: pytest.LogCaptureFixture) -> None:
    for origin in ([0, 0, 0], [5e5, 5.4e6, 100], [4e6, 1e6, 4.8e6]):  # local, UTM, from the Earth's centre
        assert plausible_path("a.tum", STAMPS, STRAIGHT + origin).all()
    assert not caplog.records


@pytest.mark.parametrize(("out", "fine"), [(1, True), (5, True), (6, False)])
def test_few_impossible_positions_are_left_out_and_said(out: int, fine: bool, caplog: pytest.LogCaptureFixture) -> None:
    path = STRAIGHT.copy()
    path[30 : 30 + out, 1] = 3e7
    if fine:
        assert np.flatnonzero(~plausible_path("a.tum", STAMPS, path)).tolist() == list(range(30, 30 + out))
        assert f"a.tum: {out} of 100 positions lie beyond" in caplog.text
    else:
        with pytest.raises(InputError, match=r"a\.tum: 6 of 100 positions lie beyond 1e\+07, as"):
            plausible_path("a.tum", STAMPS, path)


def test_leaps_are_said(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        path, stamps_ns = STRAIGHT.copy(), STAMPS.copy()
        path[50, 0] = 9e5
        stamps_ns[70:] += 10**9 * 86_401
        assert plausible_path("a.tum", stamps_ns, path).all()
    assert "2 of 99 steps are faster than sound, the first of 899951 m in 0.1 s after the stamp 4.900" in caplog.text
    assert "1 of 99 steps are longer than a day" in caplog.text


def test_shares() -> None:
    assert few(1, 3)
    assert few(5, 100)
    assert not few(6, 100)


@pytest.mark.parametrize("R", [np.diag([1, 1, -1.0]), 2 * np.eye(3), np.full((3, 3), 1e300), np.full((3, 3), np.nan)])
def test_what_is_no_rotation_is_refused(R: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"calib\.txt: not a rotation"):
        require_rotation("calib.txt", R)
    require_rotation("calib.txt", np.eye(3) + 1e-3)
