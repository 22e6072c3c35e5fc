"""The registrations of a run: each start once, in one process or in several side by side."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import as_completed
from contextlib import closing
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.registration import Registration
from wiclosure.pipeline.runtime.processes import require_wanted, side_by_side
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.types import Closure, Float32Array, FloatArray, KeyframeId, Measured, PredictionKind, Stage

Clouds: TypeAlias = Mapping[KeyframeId, Float32Array]
"""Clouds `(N, 3)` of keyframes in the body's axes."""

_AT_ONCE = 16  # closures sent to a process together: neighbours share clouds
_WORTH_PROCESSES = 2 * _AT_ONCE  # fewer are registered sooner than processes start


@dataclass(frozen=True, slots=True)
class Start:
    """All that a registration depends on, its clouds and settings apart.

    Args:
        query: keyframe.
        match: keyframe.
        numbers: scan context's yaw, predicted `T_query_match`, its covariance, and 1 where only the heading of these is
            meant; 54 numbers as bytes, NaN where there is none: compared bit by bit.
    """

    query: KeyframeId
    match: KeyframeId
    numbers: bytes

    @classmethod
    def of(cls, proposed: Closure) -> Start:
        """Where the registration of a proposed closure starts."""
        numbers = np.full(54, np.nan)
        if proposed.scan_context is not None:
            numbers[0] = proposed.scan_context.yaw_rad
        if (prediction := proposed.prediction) is not None:
            numbers[1:17], numbers[17:53] = np.ravel(prediction.T_query_match), np.ravel(prediction.covariance)
            numbers[53] = prediction.kind is PredictionKind.HEADING
        return cls(proposed.query, proposed.match, numbers.tobytes())

    @property
    def row(self) -> FloatArray:
        """The numbers `(54,)`."""
        return np.frombuffer(self.numbers)


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """What a registration found from one start.

    Args:
        measured: relative pose; None where there was too little to register.
        accepted: whether registration let the closure through.
        reason: why, or why not.
        seconds: that it took.
    """

    measured: Measured | None
    accepted: bool
    reason: str
    seconds: float

    @classmethod
    def of(cls, closure: Closure, seconds: float) -> Registered:
        """From a closure as registration left it."""
        return cls(closure.measured, closure.survived(Stage.REGISTRATION), closure.reason, seconds)

    def applied_to(self, proposed: Closure) -> Closure:
        """A closure that was proposed with this start, as registration leaves it."""
        closure = proposed if self.measured is None else proposed.measured_as(self.measured)
        decide = closure.accepted if self.accepted else closure.rejected
        return decide(Stage.REGISTRATION, self.reason)


KnownRegistrations: TypeAlias = dict[Start, Registered]
"""Registrations done so far with some clouds and settings."""


@dataclass(frozen=True, eq=False)
class RegistrationPool:
    """Registers closures of some robots.

    Args:
        settings: of the registration.
        clouds: of all keyframes that may occur.
        known: registrations done so far.  Arms of a comparison share it: a pair registered from the same start is
            registered once, and its time is charged to every arm that needs it.
        jobs: processes; results are the same for any number.
    """

    settings: RegistrationSettings
    clouds: Clouds
    known: KnownRegistrations = field(default_factory=dict)
    jobs: int = 1

    def register(self, proposed: Sequence[Closure], progress: Progress) -> tuple[list[Closure], float]:
        """Every proposed closure as registration leaves it, and the seconds that takes if none was known before."""
        starts = [Start.of(closure) for closure in proposed]
        new = {start: closure for start, closure in zip(starts, proposed, strict=True) if start not in self.known}
        work = [_Work(start, closure) for start, closure in new.items()]
        done = self._here(work) if self.jobs == 1 or len(work) < _WORTH_PROCESSES else self._side_by_side(work)
        with closing(done):  # an interruption here ends the processes at once
            self.known.update(progress.track(done, "registration", len(work)))
        found = [self.known[start] for start in starts]
        closures = [registered.applied_to(closure) for registered, closure in zip(found, proposed, strict=True)]
        return closures, sum(registered.seconds for registered in found)

    def _here(self, work: Sequence[_Work]) -> Generator[tuple[Start, Registered], None, None]:
        # A registration of its own for every run: preparing a cloud is part of what each run costs.
        registration = Registration(self.settings)
        return (_registered(registration, w, self.clouds) for w in work)

    def _side_by_side(self, work: Sequence[_Work]) -> Generator[tuple[Start, Registered], None, None]:
        batches = [_Batch.of(work[begin : begin + _AT_ONCE], self.clouds) for begin in range(0, len(work), _AT_ONCE)]
        with side_by_side(
            _Worker.register, batches, min(self.jobs, len(batches)), begin=_Worker.begin, given=(self.settings,)
        ) as futures:
            for future in as_completed(futures):
                yield from future.result()


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    start: Start
    proposed: Closure


@dataclass(frozen=True, slots=True, eq=False)
class _Batch:
    """Closures to register, and the clouds that they need."""

    work: Sequence[_Work]
    clouds: Clouds

    @classmethod
    def of(cls, work: Sequence[_Work], clouds: Clouds) -> _Batch:
        return cls(work, {key: clouds[key] for w in work for key in (w.start.query, w.start.match)})


class _Worker:
    """What happens in another process."""

    registration: Registration
    clouds: dict[KeyframeId, Float32Array]

    @classmethod
    def begin(cls, settings: RegistrationSettings) -> None:
        cls.registration, cls.clouds = Registration(settings), {}

    @classmethod
    def register(cls, batch: _Batch) -> list[tuple[Start, Registered]]:
        # Those of earlier batches stay, since what was prepared of them is known by the array itself.
        cls.clouds = {**batch.clouds, **cls.clouds}
        return [_registered(cls.registration, w, cls.clouds) for w in batch.work]


def _registered(registration: Registration, work: _Work, clouds: Clouds) -> tuple[Start, Registered]:
    require_wanted()
    began = time.perf_counter()
    closure = registration.verify(work.proposed, clouds[work.start.query], clouds[work.start.match])
    return work.start, Registered.of(closure, time.perf_counter() - began)
