from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.graph_files.records import (
    MAX_KEY,
    Remarks,
    from_euler,
    from_planar,
    from_quaternions,
    lifted_information,
    require_key,
)
from wiclosure.errors import InputError

SEEDS = st.integers(0, 2**32 - 1)


@given(seed=SEEDS, length=st.floats(0.01, 100.0))
def test_quaternions_of_any_length_and_euler_angles_are_the_same_pose(seed, length):
    rng = np.random.default_rng(seed)
    rotation, translation = Rotation.random(4, rng=rng), rng.normal(0, 1e3, (4, 3))
    expected = se3.from_rotation_translation(rotation.as_matrix(), translation)
    T, defects = from_quaternions(np.column_stack([translation, length * rotation.as_quat()]))
    np.testing.assert_allclose(T, expected, atol=1e-9)
    assert defects == [""] * 4
    turned, _ = from_euler(np.column_stack([translation, rotation.as_euler("xyz")]))
    np.testing.assert_allclose(turned, expected, atol=1e-6)


def test_planar_poses_lie_in_the_plane():
    (T,), defects = from_planar(np.array([[1.0, 2.0, 0.5]]))
    np.testing.assert_allclose(T, se3.from_yaw(0.5, np.array([1.0, 2.0, 0.0])), atol=1e-12)
    assert defects == [""]


@pytest.mark.parametrize(
    ("row", "defect"),
    [
        ([0, 0, 0, 0, 0, 0, 0], "its quaternion is zero"),
        ([0, 0, 0, 0, 0, 0, 1e7], "its quaternion is no rotation"),
        ([0, np.nan, 0, 0, 0, 0, 1], "a number is not finite"),
        ([0, 0, 0, 0, np.inf, 0, 1], "a number is not finite"),
        ([0, 0, -2e8, 0, 0, 0, 1], "2e+08 m is no distance on Earth"),
    ],
)
def test_what_is_no_pose_says_why_and_spoils_no_other_row(row, defect):
    T, defects = from_quaternions(np.array([row, [1, 2, 3, 0, 0, 0, 1]], float))
    assert defects == [defect, ""]
    assert np.isnan(T[0]).all()
    np.testing.assert_array_equal(T[1, :3, 3], [1, 2, 3])


@given(seed=SEEDS)
def test_lifting_keeps_what_the_plane_states(seed):
    A = np.random.default_rng(seed).normal(size=(3, 3, 3))
    planar = A @ np.swapaxes(A, 1, 2) + 0.1 * np.eye(3)
    lifted = lifted_information(planar)
    np.testing.assert_array_equal(lifted[:, [[3], [4], [2]], [3, 4, 2]], planar)
    assert (np.linalg.eigvalsh(lifted) > 0).all()
    np.testing.assert_allclose(lifted[:, 5, 5], (planar[:, 0, 0] + planar[:, 1, 1]) / 2)


def test_keys_fit_64_bits():
    assert require_key(MAX_KEY, "a.g2o, line 1") == MAX_KEY
    for key in (-1, MAX_KEY + 1, 10**50):
        with pytest.raises(InputError, match=r"a\.g2o, line 1: a key must be a number from 0 to 2\^64 - 1"):
            require_key(key, "a.g2o, line 1")


def test_of_remarks_alike_the_first_is_said_and_the_others_are_counted():
    remarks = Remarks()
    remarks.add("scale", "line 3: scaled")
    remarks.add("other", "line 4: turned", 0)
    remarks.add("scale", "line 5: scaled", 2)
    remarks.add("lone", "line 6: alone")
    assert remarks.sentences() == ("line 3: scaled (and 2 more like it)", "line 6: alone")
