from __future__ import annotations

from collections.abc import Iterator

import pytest

from wiclosure.pipeline.runtime.progress import NoProgress


def test_it_passes_items_on_one_by_one_and_shows_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    taken: list[int] = []

    def items() -> Iterator[int]:
        for item in range(3):
            taken.append(item)
            yield item

    tracked = NoProgress().track(items(), "work", 3)
    assert next(tracked) == 0
    assert taken == [0]
    assert list(tracked) == [1, 2]
    with NoProgress().together({"alpha": 3}, "odometry") as show:
        show("alpha", 1)
    assert capsys.readouterr() == ("", "")
