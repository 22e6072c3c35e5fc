"""Fits the drift model to real KISS-ICP odometry, and checks it on the sequence that the fit did not see.

    python benchmarks/drift.py [--bias]

The likelihood is that of horizontal displacements over 20 to 800 m, every length with the same weight.  Printed are the
parameters, and for the held-out sequence NEES per dimension and the share of truth within the 90 % intervals, for each
of the three ways to hold one out; then the fit to all three, which gives the defaults of `DriftModel`.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from kitti import every, lidar_poses
from scipy.optimize import minimize

from wiclosure import se3
from wiclosure.drift import AccumulatedDrift, DriftModel
from wiclosure.types import FloatArray, IntArray, Trajectory

LENGTHS_M = (20, 50, 100, 200, 400, 800)
NAMES = ("translation_walk", "rotation_walk", "rotation_walk_turning", "translation_bias", "rotation_bias")
START = (0.03, 0.0005, 0.002, 0.002, 2e-5)


@dataclass(frozen=True)
class Recording:
    """Keyframes of one sequence and, for each length, pairs of them that far apart on the road."""

    truth: FloatArray
    odometry: FloatArray
    pairs: tuple[tuple[IntArray, IntArray], ...]

    @classmethod
    def of(cls, sequence: str) -> Recording:
        """Keyframes every 2 m, a pair from every third."""
        truth, odometry = lidar_poses("gt", sequence), lidar_poses("kiss_icp", sequence)
        trajectory = Trajectory(sequence, np.arange(len(odometry)) * 10**9, odometry)
        rows = every(trajectory, 2.0)
        trajectory, truth = trajectory.subset(rows), truth[rows]
        pairs = []
        for length in LENGTHS_M:
            i = np.arange(0, len(rows), 3)
            j = np.searchsorted(trajectory.distance, trajectory.distance[i] + length)
            pairs.append((i[j < len(rows)], j[j < len(rows)]))
        return cls(truth, trajectory.poses, tuple(pairs))

    def errors(self, model: DriftModel) -> list[tuple[FloatArray, FloatArray]]:
        """For each length: errors of horizontal displacements `(M, 2)`, and what the model expects `(M, 2, 2)`."""
        drift = AccumulatedDrift.along(self.odometry, model)
        result = []
        for i, j in self.pairs:
            estimated, true = se3.between(self.odometry[i], self.odometry[j]), se3.between(self.truth[i], self.truth[j])
            covariance = drift.covariance(self.odometry, i, j)[:, 3:, 3:]
            R = estimated[:, :3, :3]
            in_i = R @ covariance @ np.swapaxes(R, 1, 2)
            result.append(((true - estimated)[:, :2, 3], in_i[:, :2, :2]))
        return result


def negative_log_likelihood(model: DriftModel, recordings: list[Recording]) -> float:
    """Mean over pairs, summed over lengths and recordings."""
    total = 0.0
    for recording in recordings:
        for error, C in recording.errors(model):
            total += 0.5 * float(np.mean(np.log(np.linalg.det(C)) + squared(error, C)))
    return total


def squared(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Squared Mahalanobis distances `(M,)`."""
    return np.asarray(np.einsum("mi,mij,mj->m", error, np.linalg.inv(covariance), error))


def fit(recordings: list[Recording], bias: bool) -> DriftModel:
    """The most likely model."""
    size = 5 if bias else 3

    def model(logs: FloatArray) -> DriftModel:
        return DriftModel(**dict(zip(NAMES, np.exp(logs).tolist(), strict=False)))

    def cost(logs: FloatArray) -> float:
        return negative_log_likelihood(model(logs), recordings)

    best = minimize(
        cost,
        np.asarray(np.log(START[:size]), np.float64),
        method="Nelder-Mead",
        options={"maxiter": 300, "xatol": 0.03, "fatol": 0.01},
    )
    return model(best.x)


def describe(model: DriftModel) -> str:
    return " ".join(f"{name}={value:.5f}" for name, value in model.model_dump().items() if value > 1e-7)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bias", action="store_true", help="fit constant errors as well")
    bias = parser.parse_args().bias
    recordings = {sequence: Recording.of(sequence) for sequence in ("00", "05", "08")}
    coverage = []
    for held_out, recording in recordings.items():
        model = fit([r for name, r in recordings.items() if name != held_out], bias)
        print(f"held out {held_out}: {describe(model)}")
        print(f"  negative log-likelihood {negative_log_likelihood(model, [recording]):.2f}")
        coverage.append(report(recording, model))
    print(f"held out, all: within 90 % interval {np.mean(coverage):.3f}")
    model = fit(list(recordings.values()), bias)
    print(f"all three: {describe(model)}")
    print(f"  negative log-likelihood {negative_log_likelihood(model, list(recordings.values())):.2f}")
    coverage = []
    for name, recording in recordings.items():
        print(f"  {name} under it")
        coverage.append(report(recording, model))
    print(f"  all under it: within 90 % interval {np.mean(coverage):.3f}")


def report(recording: Recording, model: DriftModel) -> float:
    """NEES and coverage for each length; the mean coverage."""
    coverage = []
    for length, (error, C) in zip(LENGTHS_M, recording.errors(model), strict=True):
        inside = np.abs(error) < 1.645 * np.sqrt(np.einsum("mii->mi", C))
        print(f"  {length:4d} m: NEES/2 {squared(error, C).mean() / 2:5.2f}, within 90 % interval {inside.mean():.3f}")
        coverage.append(inside.mean())
    return float(np.mean(coverage))


if __name__ == "__main__":
    main()
