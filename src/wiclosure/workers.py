"""Work side by side: what a pool of workers does for the stages, and the pool that is this process alone."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@dataclass(slots=True)
class WorkCosts:
    """What work elsewhere took.

    Args:
        workers: those that worked.
        retries: pieces of work given to another worker, since theirs died.
        bytes_moved: arguments sent, and results received.
    """

    workers: set[str] = field(default_factory=set)
    retries: int = 0
    bytes_moved: int = 0


class Workers(Protocol):
    """Runs a function over items: here, in processes, or on other machines; the results are the same."""

    @property
    def costs(self) -> WorkCosts | None:
        """So far, where the work is done on other machines."""
        ...

    @property
    def count(self) -> int:
        """How many items are worked on at a time."""
        ...

    @property
    def remote(self) -> bool:
        """Whether results should come by way of the stage cache, which workers and this process share."""
        ...

    def each(
        self,
        work: Callable[[_Item], _Result],
        items: Iterable[_Item],
        *,
        named: Callable[[_Item], str] = str,
        told: Callable[..., None] | None = None,
    ) -> Generator[tuple[int, _Result], None, None]:
        """The number of each item and its result, as they are done; closing the generator ends what still runs.

        Args:
            work: a function of a module (or a `functools.partial` of one), on one item.
            items: what is sent to the workers, one by one; taken a few ahead of what is worked on.
            named: how an item is called in messages.
            told: takes what the work tells meanwhile, see `tell`.

        Raises:
            ProcessError: workers died.
        """
        ...


class ThisProcess:
    """One item after the other, here."""

    costs = None
    count = 1
    remote = False

    def each(
        self,
        work: Callable[[_Item], _Result],
        items: Iterable[_Item],
        *,
        named: Callable[[_Item], str] = str,
        told: Callable[..., None] | None = None,
    ) -> Generator[tuple[int, _Result], None, None]:
        """See `Workers`."""
        for number, item in enumerate(items):
            with at_work(told=told):
                result = work(item)
            yield number, result


_told: ContextVar[Callable[..., None] | None] = ContextVar("told", default=None)
_wanted: ContextVar[Callable[[], bool] | None] = ContextVar("wanted", default=None)


@contextmanager
def at_work(*, told: Callable[..., None] | None = None, wanted: Callable[[], bool] | None = None) -> Iterator[None]:
    """For workers: who listens to the work done inside, and who knows whether anybody waits for it still.

    What the listener tells in turn goes to whoever listens outside.
    """
    outside = _told.get()

    def passed_on(*news: object) -> None:
        token = _told.set(outside)
        try:
            if told is not None:
                told(*news)
        finally:
            _told.reset(token)

    tokens = _told.set(passed_on if told else outside), _wanted.set(wanted or _wanted.get())
    try:
        yield
    finally:
        _told.reset(tokens[0])
        _wanted.reset(tokens[1])


def tell(*news: object) -> None:
    """To be called in long work: tells whoever waits for it how far it is."""
    if (told := _told.get()) is not None:
        told(*news)


def require_wanted() -> None:
    """To be called now and then in long work: ends it when nobody waits for its result any more.

    Raises:
        InterruptedError: the process that began it was interrupted.
    """
    if (wanted := _wanted.get()) is not None and not wanted():
        raise InterruptedError("nobody waits for this work any more")


def batches(items: Sequence[_Item], size: int) -> list[Sequence[_Item]]:
    """Successive items together, `size` each."""
    return [items[begin : begin + size] for begin in range(0, len(items), size)]
