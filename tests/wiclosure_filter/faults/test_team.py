"""Orders of names: the odds against them decide what is said."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.wiclosure_filter.faults.corrections import swapped
from wiclosure.wiclosure_filter.faults.team import NameOrders

ORDER = swapped({"a": "b", "b": "c", "c": "a"})


@pytest.mark.parametrize(
    ("ahead", "mixed_up", "doubted"), [(-10.0, False, False), (2.0, False, True), (9.0, True, True)]
)
def test_an_order_is_named_where_it_is_far_likelier_and_doubted_where_it_is_as_likely(
    ahead: float, mixed_up: bool, doubted: bool
) -> None:
    orders = NameOrders(100.0, ((100.0 + ahead, ORDER), (-np.inf, ORDER)))
    assert (orders.mixed_up is ORDER) is mixed_up
    assert bool(orders.objection(20.0)) is doubted


def test_nothing_is_said_where_no_order_was_tried() -> None:
    assert NameOrders().mixed_up is None
    assert NameOrders().objection(20.0) == ""
