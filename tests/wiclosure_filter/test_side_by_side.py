"""Batches of pairs of robots; what workers make of them is tested with the whole filter."""

from __future__ import annotations

from wiclosure.wiclosure_filter import side_by_side


def test_batches_are_taken_as_they_are_asked_for() -> None:
    taken = []

    def items() -> object:
        for item in range(5):
            taken.append(item)
            yield item

    parts = side_by_side.batched(items(), 2)  # type: ignore[arg-type]
    assert next(parts) == (0, 1)
    assert taken == [0, 1]
    assert list(parts) == [(2, 3), (4,)]
