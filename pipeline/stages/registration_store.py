"""Registrations of earlier runs, kept by pair: other filters, seeds and thresholds of the back end need them again."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.stages.registrations import Known, Registered, Start
from wiclosure.types import Closure, Decision, Evidence, Float32Array, FloatArray, KeyframeId

_STAGE = "registrations"


@dataclass(frozen=True, eq=False)
class RegistrationStore:
    """The registrations of some robots' clouds under some settings.

    Args:
        cache: where they are kept.
        fronts: the clouds.
        settings: of the registration.
    """

    cache: StageCache
    fronts: Mapping[str, FrontEndResult]
    settings: RegistrationSettings

    def recall(self, known: Known) -> int:
        """Adds those of earlier runs to `known`, which has how many then."""
        if self.cache.folder is not None:
            for key, registered in (self.cache.find(_STAGE, self._depends_on(), load=_load) or {}).items():
                known.setdefault(key, registered)
        return len(known)

    def keep(self, known: Known) -> None:
        """Keeps all for later runs."""
        if self.cache.folder is not None:
            self.cache.keep(_STAGE, self._depends_on(), known, save=_save)

    def _depends_on(self) -> object:
        settings = self.settings.model_dump(exclude={"num_threads", "cached_clouds"})
        return [{robot: _digest(front.clouds) for robot, front in self.fronts.items()}, settings]


def _digest(clouds: tuple[Float32Array, ...]) -> str:
    digest = hashlib.sha256()
    for cloud in clouds:
        digest.update(len(cloud).to_bytes(8, "little"))
        digest.update(np.ascontiguousarray(cloud).data)
    return digest.hexdigest()


def _save(known: Known, path: Path) -> None:
    closures = [registered.closure for registered in known.values()]
    with path.open("wb") as file:
        np.savez(
            file,
            robots=np.array([[c.query.robot, c.match.robot] for c in closures]),
            indices=np.array([[c.query.index, c.match.index] for c in closures]),
            starts=np.array([start.row for start in known]),
            poses=np.array([c.T_query_match for c in closures]),
            covariances=np.array([c.covariance for c in closures]),
            evidence=np.array([astuple(c.evidence) for c in closures], np.float64),
            decisions=np.array([c.decision.value for c in closures]),
            reasons=np.array([c.reason for c in closures]),
            seconds=np.array([registered.seconds for registered in known.values()]),
        )


def _load(path: Path) -> Known:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as pack:
        content = {name: pack[name] for name in pack.files}
    known: Known = {}
    for row, (robots, indices) in enumerate(zip(content["robots"], content["indices"], strict=True)):
        query, match = (KeyframeId(str(r), int(i)) for r, i in zip(robots, indices, strict=True))
        closure = Closure(
            query=query,
            match=match,
            T_query_match=content["poses"][row],
            covariance=content["covariances"][row],
            evidence=_evidence(content["evidence"][row]),
            decision=Decision(str(content["decisions"][row])),
            reason=str(content["reasons"][row]),
        )
        start = Start(query, match, content["starts"][row].tobytes())
        known[start] = Registered(closure, float(content["seconds"][row]))
    return known


def _evidence(row: FloatArray) -> Evidence:
    values = {field.name: float(value) for field, value in zip(fields(Evidence), row, strict=True)}
    inliers, consistent_with = (int(values.pop(name)) for name in ("inliers", "consistent_with"))
    return Evidence(**values, inliers=inliers, consistent_with=consistent_with)
