from __future__ import annotations

import numpy as np
import pytest

from wiclosure.arrays import float_array, stamp, stamp_array
from wiclosure.errors import InputError


def test_lists_and_integers_become_float64_and_floats_are_not_copied():
    np.testing.assert_array_equal(float_array([[1, 2], [3, 4]], "poses"), [[1.0, 2.0], [3.0, 4.0]])
    assert float_array(np.array([1, 2], np.int32), "poses").dtype == np.float64
    own = np.arange(3.0)
    assert float_array(own, "poses") is own


@pytest.mark.parametrize(
    ("values", "described"),
    [
        ([[1.0], [1.0, 2.0]], "a list"),
        ("abc", "a str"),
        (None, "a NoneType"),
        (np.array(["1.0", "2.0"]), r"a ndarray of shape \(2,\) and type <U3"),
        (np.zeros((2, 2), complex), r"a ndarray of shape \(2, 2\) and type complex128"),
        ([True, False], "a list"),
    ],
)
def test_what_is_no_array_of_numbers_is_named(values, described):
    with pytest.raises(InputError, match=f"^poses: expected an array of numbers, got {described}$"):
        float_array(values, "poses")


def test_stamps_keep_every_nanosecond():
    largest = 2**63 - 1
    assert stamp_array([0, largest], "stamps_ns").tolist() == [0, largest]
    assert stamp_array([], "stamps_ns").dtype == np.int64
    assert stamp_array(np.array([3], np.uint8), "stamps_ns").dtype == np.int64


def test_stamps_in_seconds_are_refused_with_the_way_to_convert_them():
    with pytest.raises(InputError, match=r"^stamps_ns are floats, the first 1\.5; .*np\.rint\(seconds \* 1e9\)"):
        stamp_array([1.5, 2.5], "stamps_ns")
    with pytest.raises(InputError, match="expected integers, got a list"):
        stamp_array(["now"], "stamps_ns")


@pytest.mark.parametrize("value", [1.0, "1", True, None, np.float64(2)])
def test_one_stamp_is_an_integer(value):
    with pytest.raises(InputError, match=f"^stamp_ns is {value}, a {type(value).__name__}; give integer nanoseconds"):
        stamp(value, "stamp_ns")


def test_an_integer_of_numpy_becomes_an_int():
    assert type(stamp(np.int64(7), "stamp_ns")) is int
    assert stamp(7, "stamp_ns") == 7
