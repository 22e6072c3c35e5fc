from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.graph_files.matrices import covariances
from wiclosure.backends.graph_files.records import Edge, Remarks
from wiclosure.backends.graph_files.settings import GraphFileSettings
from wiclosure.errors import InputError


def edges(*information):
    return [Edge(0, 1, f"g.g2o, line {n}", np.eye(4), matrix) for n, matrix in enumerate(information, start=1)]


def stated(*information, **settings):
    remarks = Remarks()
    return covariances(edges(*information), GraphFileSettings(**settings), remarks), remarks.sentences()


def test_a_covariance_is_the_inverse():
    A = np.random.default_rng(0).normal(size=(6, 6))
    found, said = stated(A @ A.T + np.eye(6))
    np.testing.assert_allclose(found.matrices[0] @ (A @ A.T + np.eye(6)), np.eye(6), atol=1e-12)
    assert said == ()


def test_without_information_the_settings_are_assumed_and_counted():
    found, said = stated(None, np.eye(6), None, sigma_m=0.5, sigma_rad=0.1)
    np.testing.assert_allclose(found.matrices[0], np.diag([0.01] * 3 + [0.25] * 3))
    np.testing.assert_allclose(found.matrices[1], np.eye(6))
    assert said[0].startswith("g.g2o, line 1: 2 of 3 edges state no information; 0.5 m and 0.1 rad are assumed")


def test_few_indefinite_matrices_are_left_out_and_many_refused():
    bad = np.diag([1.0, 1, 1, 1, 1, -2])
    found, _ = stated(bad, *[np.eye(6)] * 19)
    assert [bool(defect) for defect in found.defects] == [True] + [False] * 19
    with pytest.raises(InputError, match=r"line 1: 7 of 20 information matrices .* graphs.indefinite=repair"):
        stated(*[bad] * 7, *[np.eye(6)] * 13)


def test_repair_knows_nothing_along_negative_axes():
    found, said = stated(*[np.diag([4.0, 1, 1, 1, 1, -2])] * 5, indefinite="repair")
    np.testing.assert_allclose(np.diag(found.matrices[0]), [0.25, 1, 1, 1, 1, 1e8])
    assert found.defects == [""] * 5
    assert "(and 4 more like it)" in said[0]


def test_numbers_that_no_sensor_states_are_defects_or_capped():
    found, said = stated(np.diag([1e200] + [1.0] * 5), np.diag([1e20] * 6), np.full((6, 6), np.nan))
    assert found.defects == ["its information matrix is not finite", "", "its information matrix is not finite"]
    np.testing.assert_allclose(found.matrices[1], 1e-14 * np.eye(6))
    assert "more than 1e+14" in said[0]
