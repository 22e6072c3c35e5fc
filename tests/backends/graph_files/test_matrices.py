from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.backends.graph_files.matrices import INDEFINITE, NO_NUMBERS, covariances
from wiclosure.backends.graph_files.records import Edge, Remarks
from wiclosure.backends.graph_files.settings import GraphFileSettings
from wiclosure.errors import InputError

REFUSE, REPAIR = GraphFileSettings(indefinite="refuse"), GraphFileSettings(indefinite="repair")


def edges(*information, defect=""):
    return [Edge(n, n + 1, f"a.g2o, line {n + 1}", np.eye(4), matrix, defect) for n, matrix in enumerate(information)]


@given(seed=st.integers(0, 2**32 - 1))
def test_sound_information_is_inverted(seed):
    A = np.random.default_rng(seed).normal(size=(4, 6, 6))
    information = A @ np.swapaxes(A, 1, 2) + 0.1 * np.eye(6)
    remarks = Remarks()
    found = covariances(edges(*information), REFUSE, remarks)
    np.testing.assert_allclose(found.matrices @ information, np.tile(np.eye(6), (4, 1, 1)), atol=1e-6)
    assert found.defects == [""] * 4
    assert remarks.sentences() == ()


def test_where_none_is_stated_the_settings_are_assumed_and_said():
    settings = GraphFileSettings(sigma_m=0.5, sigma_rad=0.1)
    remarks = Remarks()
    found = covariances(edges(np.eye(6), None, None), settings, remarks)
    np.testing.assert_allclose(found.matrices[1], np.diag([0.01] * 3 + [0.25] * 3))
    (sentence,) = remarks.sentences()
    assert sentence.startswith("a.g2o, line 2: 2 of 3 edges state no information; 0.5 m and 0.1 rad are assumed")


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e40])
def test_what_is_no_information_is_a_defect_and_its_neighbours_are_used(bad):
    wrong = np.eye(6)
    wrong[2, 2] = bad
    found = covariances(edges(wrong, 4 * np.eye(6)), REFUSE, Remarks())
    assert found.defects == [NO_NUMBERS, ""]
    np.testing.assert_allclose(found.matrices[1], np.eye(6) / 4)


def test_an_axis_of_which_nothing_is_known_becomes_wide_and_one_too_exact_is_held():
    singular, exact = np.eye(6), np.eye(6)
    singular[5, 5], exact[0, 0] = 0.0, 1e20
    remarks = Remarks()
    found = covariances(edges(singular, exact), REFUSE, remarks)
    assert found.matrices[0, 5, 5] == pytest.approx(1e8)
    assert found.matrices[0, 0, 0] == pytest.approx(1.0)
    assert found.matrices[1, 0, 0] == pytest.approx(1e-14)
    assert [s.partition(": ")[0] for s in remarks.sentences()] == ["a.g2o, line 1", "a.g2o, line 2"]


def test_a_few_indefinite_matrices_are_accidents_and_many_a_habit():
    indefinite = np.diag([1.0, 1, 1, 1, 1, -1])
    found = covariances(edges(indefinite, *[np.eye(6)] * 9), REFUSE, Remarks())
    assert found.defects == [INDEFINITE] + [""] * 9
    with pytest.raises(InputError, match=r"line 2: 3 of 4 information matrices .* --set graphs\.indefinite=repair"):
        covariances(edges(np.eye(6), *[indefinite] * 3), REFUSE, Remarks())
    remarks = Remarks()
    repaired = covariances(edges(np.eye(6), *[indefinite] * 3), REPAIR, remarks)
    assert repaired.defects == [""] * 4
    np.testing.assert_allclose(np.diag(repaired.matrices[1]), [1, 1, 1, 1, 1, 1e8])
    assert remarks.sentences()[0].endswith("its negative axes are taken as unknown (and 2 more like it)")


def test_defects_of_poses_stay_and_no_edges_are_none():
    assert covariances(edges(np.eye(6), defect="no pose"), REFUSE, Remarks()).defects == ["no pose"]
    assert covariances([], REFUSE, Remarks()).matrices.shape == (0, 6, 6)


def test_empty_matrices_are_accidents_or_a_writer_that_states_none():
    remarks = Remarks()
    found = covariances(edges(*[np.zeros((6, 6))] * 3, *[np.eye(6)] * 9), REFUSE, remarks)
    np.testing.assert_allclose(found.matrices[:3], np.tile(np.eye(6), (3, 1, 1)))
    assert "line 1: 3 of 12 edges state no information; 1 m and 1 rad are assumed" in remarks.sentences()[0]
    accident = covariances(edges(np.zeros((6, 6)), *[np.eye(6)] * 9), REFUSE, Remarks())
    assert accident.matrices[0, 0, 0] == pytest.approx(1e8)
