"""The registrations of a run: each start once, in one process or in several side by side."""

from __future__ import annotations

import time
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from threading import local
from typing import TypeAlias

import numpy as np

from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.registration.registration import Registration
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.pipeline.stages.stored_clouds import StoredClouds
from wiclosure.types import Closure, Float32Array, FloatArray, KeyframeId, Measured, PredictionKind, Stage
from wiclosure.workers import ThisProcess, Workers, batches, require_wanted

Clouds: TypeAlias = Mapping[KeyframeId, Float32Array]
"""Clouds `(N, 3)` of keyframes in the body's axes."""

_AT_ONCE = 16  # closures sent to a process together, at most: neighbours share clouds
_SHARES = 8  # for each process, at least: at the end no process waits long for the others
_WORTH_WORKERS = 2 * _AT_ONCE  # fewer are registered sooner than processes start


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
        workers: who registers; results are the same for all.
        stored: by robot, where workers that share no memory find the clouds.
    """

    settings: RegistrationSettings
    clouds: Clouds
    known: KnownRegistrations = field(default_factory=dict)
    workers: Workers = field(default_factory=ThisProcess)
    stored: Mapping[str, StoredClouds] = field(default_factory=dict)

    def register(self, proposed: Sequence[Closure], progress: Progress) -> tuple[list[Closure], float]:
        """Every proposed closure as registration leaves it, and the seconds that takes if none was known before."""
        starts = [Start.of(closure) for closure in proposed]
        new = {start: closure for start, closure in zip(starts, proposed, strict=True) if start not in self.known}
        work = [_Work(start, closure) for start, closure in new.items()]
        done = (
            self._here(work)
            if (self.workers.count == 1 and not self.stored) or len(work) < _WORTH_WORKERS
            else self._side_by_side(work)
        )
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
        ordered = sorted(work, key=lambda w: (w.start.query.robot, w.start.query.index))
        size = max(1, min(_AT_ONCE, len(work) // (_SHARES * self.workers.count)))
        parts = [_Batch.of(part, self) for part in batches(ordered, size)]
        with closing(self.workers.each(_register, parts)) as done:
            for _, found in done:
                yield from found


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    start: Start
    proposed: Closure


@dataclass(frozen=True, slots=True, eq=False)
class _Batch:
    """Closures to register: about a second's work, those of one keyframe together.

    Args:
        work: the closures.
        settings: of the registration.
        clouds: that they need; empty where they are stored.
        stored: where the clouds of their robots lie, else.
    """

    work: Sequence[_Work]
    settings: RegistrationSettings
    clouds: Clouds
    stored: Mapping[str, StoredClouds]

    @classmethod
    def of(cls, work: Sequence[_Work], pool: RegistrationPool) -> _Batch:
        keys = {key for w in work for key in (w.start.query, w.start.match)}
        if pool.stored:
            return cls(work, pool.settings, {}, {key.robot: pool.stored[key.robot] for key in keys})
        return cls(work, pool.settings, {key: pool.clouds[key] for key in keys}, {})

    def __str__(self) -> str:
        first = self.work[0].start
        return (
            f"the registration of {len(self.work)} closures, the first of {first.query.robot} {first.query.index}"
            f" and {first.match.robot} {first.match.index}"
        )

    def cloud(self, key: KeyframeId) -> Float32Array:
        return self.stored[key.robot].load()[key.index] if self.stored else self.clouds[key]


class _Own(local):
    """What a worker's thread keeps from one batch to the next: what was prepared of a cloud is known by the array."""

    settings: RegistrationSettings | None = None
    registration: Registration
    clouds: dict[KeyframeId, Float32Array]


_own = _Own()


def _register(batch: _Batch) -> list[tuple[Start, Registered]]:
    if _own.settings != batch.settings:
        _own.settings, _own.registration, _own.clouds = batch.settings, Registration(batch.settings), {}
    _own.clouds = {**batch.clouds, **_own.clouds}
    clouds = {key: batch.cloud(key) for w in batch.work for key in (w.start.query, w.start.match)} | _own.clouds
    return [_registered(_own.registration, w, clouds) for w in batch.work]


def _registered(registration: Registration, work: _Work, clouds: Clouds) -> tuple[Start, Registered]:
    require_wanted()
    began = time.perf_counter()
    closure = registration.verify(work.proposed, clouds[work.start.query], clouds[work.start.match])
    return work.start, Registered.of(closure, time.perf_counter() - began)
