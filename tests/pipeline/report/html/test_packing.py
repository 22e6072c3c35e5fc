from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from wiclosure.pipeline.report.html.packing import (
    along_curve,
    packed_bytes,
    packed_steps,
    sharing,
    unpacked_array,
    without_sharing,
)


@given(
    arrays(np.float64, array_shapes(min_dims=1, max_dims=2, min_side=0), elements=st.floats(-1e6, 1e6)),
    st.sampled_from([0.001, 0.02, 1.0]),
)
def test_numbers_come_back_within_half_a_step(values: np.ndarray, step: float) -> None:
    found = unpacked_array(packed_steps(values, step))
    assert found.shape == values.shape
    assert np.abs(found - values).max(initial=0.0) <= 0.5 * step + 1e-9


def test_what_is_no_number_stays_none() -> None:
    values = np.array([[1.0, np.nan], [np.inf, -2.0], [3.0, 4.0]])
    expected = [[1.0, np.nan], [np.nan, -2.0], [3.0, 4.0]]
    np.testing.assert_array_equal(unpacked_array(packed_steps(values, 0.5)), expected)


def test_numbers_beyond_the_range_are_cut_to_it() -> None:
    found = unpacked_array(packed_steps(np.array([1e300, -1e300, 0.0]), 1.0))
    np.testing.assert_array_equal(found, [2**31 - 1, 1 - 2**31, 0])


@given(arrays(np.uint8, array_shapes(min_dims=1, max_dims=2, min_side=0)))
def test_bytes_come_back(values: np.ndarray) -> None:
    np.testing.assert_array_equal(unpacked_array(packed_bytes(values)), values)


def test_points_along_the_curve_are_small() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 50, (20_000, 3))
    order = along_curve(points, 0.02)
    assert sorted(order) == list(range(len(points)))
    assert len(packed_steps(points[order], 0.02)["data"]) < 0.7 * len(packed_steps(points, 0.02)["data"])
    assert len(along_curve(np.zeros((0, 3)), 0.02)) == 0


def test_equal_arrays_are_stored_once() -> None:
    one, other = packed_steps(np.arange(5.0), 1.0), packed_steps(np.arange(6.0), 1.0)
    report = {"runs": [{"cloud": one, "clouds": {"a:1": one}}, {"cloud": dict(one), "other": other}], "title": "both"}
    shared = sharing(report)
    assert shared["arrays"] == [one, other]
    assert without_sharing(shared) == report
