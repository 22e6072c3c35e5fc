from __future__ import annotations

from collections.abc import Iterator

import pytest

from wiclosure.pipeline.runtime.progress import CallbackProgress, NoProgress


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


def test_a_function_is_told_what_is_done_and_of_how_many() -> None:
    told: list[tuple[str, int, int | None]] = []
    progress = CallbackProgress(lambda *words: told.append(words))
    assert list(progress.track(iter("ab"), "matching")) == ["a", "b"]
    assert list(progress.track([7], "registration")) == [7]
    with progress.together({"alpha": 3}, "odometry of") as show:
        show("alpha", 2)
    assert told == [
        ("matching", 0, None),
        ("matching", 1, None),
        ("matching", 2, None),
        ("registration", 0, 1),
        ("registration", 1, 1),
        ("odometry of alpha", 2, 3),
    ]
