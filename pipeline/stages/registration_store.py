"""Registrations of earlier runs, kept on disk: other filters, seeds and back ends need the same ones again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.unpacking import read_arrays
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.stages.registrations import KnownRegistrations, Registered, Start
from wiclosure.pipeline.stages.stored_clouds import digest_of
from wiclosure.types import FloatArray, KeyframeId, Measured, RegistrationEvidence

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

    def recall(self, known: KnownRegistrations) -> int:
        """Adds the registrations of earlier runs to `known`; returns how many it holds then."""
        if self.cache.folder is not None:
            for key, registered in (self.cache.find(_STAGE, self._depends_on(), load=_load) or {}).items():
                known.setdefault(key, registered)
        return len(known)

    def keep(self, known: KnownRegistrations) -> None:
        """Keeps all for later runs."""
        if self.cache.folder is not None:
            self.cache.keep(_STAGE, self._depends_on(), known, save=_save)

    def _depends_on(self) -> object:
        settings = self.settings.model_dump(exclude={"num_threads", "cached_clouds"})
        return [{robot: digest_of(front.clouds) for robot, front in self.fronts.items()}, settings]


def _save(known: KnownRegistrations, path: Path) -> None:
    found = list(known.values())
    with path.open("wb") as file:
        np.savez(
            file,
            robots=np.array([[start.query.robot, start.match.robot] for start in known]),
            indices=np.array([[start.query.index, start.match.index] for start in known]),
            starts=np.array([start.row for start in known]),
            measured=np.array([_row(registered.measured) for registered in found]),
            accepted=np.array([registered.accepted for registered in found]),
            reasons=np.array([registered.reason for registered in found]),
            seconds=np.array([registered.seconds for registered in found]),
        )


def _load(path: Path) -> KnownRegistrations:
    try:
        return _known(read_arrays(path))
    except (LookupError, ValueError, TypeError, ArithmeticError) as error:
        raise InputError(f"{path} holds no registrations ({error})") from error


def _known(content: Mapping[str, Any]) -> KnownRegistrations:
    known: KnownRegistrations = {}
    for row, (robots, indices) in enumerate(zip(content["robots"], content["indices"], strict=True)):
        query, match = (KeyframeId(str(r), int(i)) for r, i in zip(robots, indices, strict=True))
        known[Start(query, match, content["starts"][row].tobytes())] = Registered(
            measured=_measured(content["measured"][row]),
            accepted=bool(content["accepted"][row]),
            reason=str(content["reasons"][row]),
            seconds=float(content["seconds"][row]),
        )
    return known


def _row(measured: Measured | None) -> FloatArray:
    """Pose, covariance and evidence as 57 numbers; all NaN where nothing was measured."""
    row = np.full(57, np.nan)
    if measured is not None:
        evidence = measured.evidence
        assert evidence is not None  # registration always has some
        row[:16], row[16:52] = np.ravel(measured.T_query_match), np.ravel(measured.covariance)
        row[52:56] = evidence.inliers, evidence.inlier_ratio, evidence.agreement, evidence.rms_m
        row[56] = np.nan if evidence.prediction_chi2 is None else evidence.prediction_chi2
    return row


def _measured(row: FloatArray) -> Measured | None:
    if np.isnan(row).all():
        return None
    inliers, ratio, agreement, rms_m, chi2 = row[52:].tolist()
    evidence = RegistrationEvidence(int(inliers), ratio, agreement, rms_m, None if np.isnan(chi2) else chi2)
    return Measured(row[:16].reshape(4, 4), row[16:52].reshape(6, 6), evidence)
