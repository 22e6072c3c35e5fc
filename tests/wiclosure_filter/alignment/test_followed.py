"""Peaks that are followed through drift: mirror images weigh the same, and each stands at its own place."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.alignment.ambiguity import assess
from wiclosure.wiclosure_filter.alignment.followed import Followed, follow, rigid_transform
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.consensus.consensus import consensus
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem
from wiclosure.wiclosure_filter.drift.drifting_frames import follow_drifts
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.links.links import Links

ASIDE_M = 15.0


def passing(bend_m: float, unnoticed_m: float = 0.0, aside_m: float = ASIDE_M) -> tuple[Links, dict[str, Trajectory]]:
    """A robot that passes another one's straight road so far aside; only ranges are measured.

    Its road bends by so much, of which odometry does not notice a part.
    """
    s = np.linspace(0.0, 100.0, 30)
    a = se3.from_yaw(0 * s, np.stack([s, 0 * s, 0 * s], axis=1))
    b = se3.from_yaw(0 * s, np.stack([110 - s, aside_m + bend_m * np.sin(s / 12), 0 * s], axis=1))
    stamps_ns = np.arange(30, dtype=np.int64) * 10**9
    odometry_b = b.copy()
    odometry_b[:, 1, 3] -= unnoticed_m * np.sin(s / 12)
    team = {"a": Trajectory("a", stamps_ns, a), "b": Trajectory("b", stamps_ns, se3.inverse(b[0]) @ odometry_b)}
    metres = np.linalg.norm(b[:, :3, 3] - a[:, :3, 3], axis=1)
    log = WirelessLog(
        tuple(WirelessMeasurement(int(t), "a", "b", float(m), 0.2, ()) for t, m in zip(stamps_ns, metres, strict=True))
    )
    return WiClosureFilter().gather(team, log).by_pair["a", "b"], team


def peaks(bend_m: float, unnoticed_m: float = 0.0) -> list[Followed]:
    """Followed peaks of these two, the best first."""
    settings = AlignmentSettings()
    links, team = passing(bend_m, unnoticed_m)
    problem = AlignmentProblem.of(links, team, settings)
    found = consensus(problem, settings.proposals)
    assert found is not None
    selection = assess(found.peaks, found.mixture, found.prior, settings.guard)
    rows = (selection.best, *selection.others)
    chains = follow_drifts([rigid_transform(found, row, problem.odometry, settings.calibration) for row in rows])
    return [
        follow(found, row, links, chain, selection.covariance, settings.guard)
        for row, chain in zip(rows, chains, strict=True)
    ]


def test_mirror_images_weigh_the_same_and_lie_apart() -> None:
    best, other = peaks(bend_m=0.0)
    assert best.log_evidence == pytest.approx(other.log_evidence, abs=0.05)
    assert best.apart_m(best) == 0.0
    assert best.apart_m(other) == pytest.approx(2 * ASIDE_M, abs=1.0)


def test_a_near_by_image_that_fits_as_well_is_an_alternative() -> None:
    links, team = passing(bend_m=3.0, aside_m=4.0)  # images at 4 and about 2 m: both on one long, curved ridge
    found = align(links, team, AlignmentSettings())
    assert found.best is not None
    assert "an alignment 2.0 m away is nearly as likely where odometry drifts" in found.reason
    (other,) = found.likely_alternatives
    places = [one.T_a_b[1, 3] for one in (found.best, other)]
    assert min(abs(place - 4.0) for place in places) < 0.5
    assert abs(places[0] - places[1]) > 1.5


def test_a_near_by_image_that_bends_the_odometry_is_none() -> None:
    links, team = passing(bend_m=8.0, aside_m=4.0)
    found = align(links, team, AlignmentSettings())
    assert not found.ambiguous, found.reason
    assert found.best is not None
    assert found.best.T_a_b[1, 3] == pytest.approx(4.0, abs=0.5)


def test_a_mirror_image_that_bends_the_odometry_weighs_less() -> None:
    best, other = peaks(bend_m=2.0)
    assert best.log_evidence - other.log_evidence > 3.0


def test_odometry_that_is_bent_further_than_it_drifts_is_said() -> None:
    assert peaks(bend_m=2.0)[0].overstrained(0.01) == ""
    assert "bent further than usual ones are" in peaks(bend_m=2.0, unnoticed_m=8.0)[0].overstrained(0.01)
