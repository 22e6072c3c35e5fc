"""A robot that slips or is carried: what was measured before and after prunes its own pairs, and it is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import CandidatePairs, FilterResult, Trajectory
from wiclosure.wiclosure_filter.config import FilterSettings, GateSettings
from wiclosure.wiclosure_filter.filter import WiClosureFilter

from .faults.test_diagnosis import heard, team

NEAR_M, AT = 10.0, 40
CARRIED = se3.from_yaw(0.6, np.array([25.0, -12.0, 0.0]))


def carried(trajectory: Trajectory) -> Trajectory:
    """As odometry has it that misses a move after half of the way."""
    poses = trajectory.poses.copy()
    poses[AT:] = poses[AT] @ CARRIED @ se3.inverse(poses[AT]) @ poses[AT:]
    return replace(trajectory, poses=poses)


def filtered(slipped: str) -> tuple[FilterResult, CandidatePairs, np.ndarray]:
    """What the filter finds, and the true displacements."""
    odometry, truth = team("ab")
    odometry[slipped] = carried(odometry[slipped])
    settings = FilterSettings(gate=GateSettings(sensor_range_m=NEAR_M))
    result = WiClosureFilter(settings).candidates(odometry, heard(truth))
    (pairs,) = result.pairs
    return result, pairs, truth["b"][None, :, :3, 3] - truth["a"][:, None, :3, 3]


@pytest.mark.parametrize("slipped", ["a", "b"])
def test_pairs_before_and_after_are_pruned_by_their_own_alignment(slipped: str) -> None:
    result, pairs, displacement = filtered(slipped)
    (alignment,) = result.alignments
    assert alignment.ambiguous
    assert alignment.slipped
    assert alignment.slipped_robot == slipped  # its odometry jumps
    assert "odometry seems to slip, or a robot was moved, between" in " ".join(result.diagnosis)
    near = np.linalg.norm(displacement, axis=2) <= NEAR_M
    assert near[pairs.index_a, pairs.index_b].sum() == near.sum()
    assert len(pairs) < 0.7 * near.size


def test_predictions_hold_on_either_side() -> None:
    """Two keyframes before the slip, or two after it, lie as its side tells, whichever robot slipped."""
    _, pairs, displacement = filtered("b")
    early, late = (
        (pairs.index_a < AT - 5) & (pairs.index_b < AT - 5),
        (pairs.index_a > AT + 5) & (pairs.index_b > AT + 5),
    )
    true_m = np.linalg.norm(displacement[pairs.index_a, pairs.index_b], axis=1)
    near = (true_m <= NEAR_M) & (early | late)
    assert near.sum() > 20
    assert pairs.predictor is not None
    predicted, covariance = pairs.predictor.relative_poses("a", pairs.index_a[near], "b", pairs.index_b[near])
    off_m = np.abs(np.linalg.norm(predicted[:, :2, 3], axis=1) - true_m[near])
    sigma_m = np.sqrt(np.trace(covariance[:, 3:5, 3:5], axis1=1, axis2=2))
    assert (off_m < 3 * sigma_m).all()
    assert np.median(off_m) < 1.0
