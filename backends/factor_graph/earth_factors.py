"""Directions up and positions on the Earth as factors of the pose graph, and the frame that they need.

The world's z points up, as the robots' odometry frames do once they are levelled.  Where a component of robots has
positions, its world is the local frame east, north, up of the team's origin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.factor_graph.factors import ANCHOR, CAUCHY_WIDTH, LOOSE_ANCHOR, Keys, anchor, prior
from wiclosure.types import EarthMeasurements, FloatArray, PositionFixes, UpDirections

UP = gtsam.Unit3(0.0, 0.0, 1.0)
FEWEST_FIXES = 3
HEADING_RAD = np.radians(10.0)  # what the fixes must tell of the world's heading to be its frame
OUTVOTED = 0.5  # of a weight: below, the estimate speaks against a measurement
STRANGE = 1 / 3  # of the path's size: fixes that are off by more are not of this path; no odometry drifts so
ROUNDS = 20  # of reweighting


def earth_factors(earth: EarthMeasurements, keys: Keys, placed: Sequence[str]) -> list[gtsam.NonlinearFactor]:
    """One factor for each direction up, and for each position of the robots in `placed`, under a Cauchy kernel.

    GTSAM's attitude factor has no error in yaw; `nRef` and `bMeasured` are both up.
    """
    factors: list[gtsam.NonlinearFactor] = []
    for robot, up in earth.up.items():
        for key, direction, sigma in zip(keys.all(robot, up.index), up.up_body, up.sigma_rad.tolist(), strict=True):
            noise = _robust(gtsam.noiseModel.Isotropic.Sigma(2, sigma))
            factors.append(gtsam.AttitudeFactorPose3(key, UP, noise, gtsam.Unit3(direction)))
    for robot in placed:
        fixes = earth.fixes[robot]
        rows = zip(keys.all(robot, fixes.index), fixes.position_enu, fixes.sigma_enu, fixes.antenna_body, strict=True)
        for key, position, sigmas, antenna in rows:
            noise = _robust(gtsam.noiseModel.Diagonal.Sigmas(sigmas))
            factors.append(gtsam.GPSFactorArm(key, position, antenna, noise))
    return factors


def upright(key: int, up: UpDirections) -> gtsam.AttitudeFactorPose3:
    """An odometry frame whose z axis points up, as surely as all directions together say."""
    sigma = 1.0 / np.sqrt(max(float(np.sum(up.sigma_rad**-2.0)), 1e-12))
    return gtsam.AttitudeFactorPose3(key, UP, gtsam.noiseModel.Isotropic.Sigma(2, sigma), UP)


def _robust(noise: gtsam.noiseModel.Gaussian) -> gtsam.noiseModel.Robust:
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY_WIDTH), noise)


@dataclass(frozen=True)
class Ground:
    """How each component of robots stands on the Earth.

    Args:
        earth: what is known of it.
        placed: robots whose component has positions: its world is east, north, up.
        diagnosis: sentences on positions that do not tell enough.
    """

    earth: EarthMeasurements = field(default_factory=EarthMeasurements)
    placed: tuple[str, ...] = ()
    diagnosis: tuple[str, ...] = ()

    @classmethod
    def under(
        cls, groups: Sequence[Sequence[str]], poses: Mapping[str, FloatArray], earth: EarthMeasurements
    ) -> tuple[Ground, dict[str, FloatArray]]:
        """With all poses `(N, 4, 4)` by robot moved to where they are on the Earth."""
        placed, sentences, moved = list[str](), list[str](), dict(poses)
        for group in groups:
            T_enu_world, sentence = placed_on_earth(group, poses, earth)
            sentences += [sentence] if sentence else []
            if T_enu_world is not None:
                placed += group
                moved |= {robot: T_enu_world @ poses[robot] for robot in group}
        return cls(earth, tuple(placed), tuple(sentences)), moved

    def since(self, known: Ground) -> Ground:
        """Only what is new: each robot's measurements after those that `known` has of it."""
        up = {robot: of.after(len(known.earth.up.get(robot, ()))) for robot, of in self.earth.up.items()}
        fixes = {robot: of.after(len(known.earth.fixes.get(robot, ()))) for robot, of in self.earth.fixes.items()}
        return replace(self, earth=EarthMeasurements(up, fixes))

    def joined(self, groups: Sequence[tuple[str, ...]]) -> tuple[tuple[str, ...], ...]:
        """The groups, those that have positions as one: they are in the same frame."""
        on_earth = tuple(robot for group in groups if group[0] in self.placed for robot in group)
        left = [group for group in groups if group[0] not in self.placed]
        if not on_earth:
            return tuple(groups)
        first = next(n for n, group in enumerate(groups) if group[0] in self.placed)
        return (*left[:first], on_earth, *left[first:])

    def anchor(self, group: Sequence[str], key: int, T_world_body: FloatArray) -> gtsam.PriorFactorPose3:
        """Holds the first pose of a group in what nothing else tells: all, all but tilt, or hardly anything."""
        up = any(len(self.earth.up.get(robot, ())) for robot in group)
        if group[0] in self.placed:
            sigmas = LOOSE_ANCHOR
        elif up:
            sigmas = np.concatenate([LOOSE_ANCHOR[:2], ANCHOR[2:]])
        else:
            return anchor(key, gtsam.Pose3(T_world_body))
        to_body = np.kron(np.eye(2), T_world_body[:3, :3].T)
        return prior(key, T_world_body, to_body @ np.diag(sigmas**2) @ to_body.T)

    def factors(self, keys: Keys) -> list[gtsam.NonlinearFactor]:
        """Of all directions up, and of the positions in use."""
        return earth_factors(self.earth, keys, [robot for robot in self.placed if robot in self.earth.fixes])


def placed_on_earth(
    group: Sequence[str], poses: Mapping[str, FloatArray], earth: EarthMeasurements
) -> tuple[FloatArray | None, str]:
    """`T_enu_world (4, 4)` of one component, or None; with a sentence where fixes are there but do not tell it.

    Args:
        group: robots that closures connect.
        poses: `T_world_body (N, 4, 4)` of all keyframes by robot.
        earth: positions.
    """
    own = [robot for robot in group if len(earth.fixes.get(robot, ()))]
    if not own:
        return None, ""
    antennas = np.concatenate([earth.fixes[robot].antennas(poses[robot]) for robot in own])
    measured = np.concatenate([earth.fixes[robot].position_enu for robot in own])
    sigma = np.concatenate([np.linalg.norm(earth.fixes[robot].sigma_enu[:, :2], axis=1) for robot in own])
    names = " and ".join(own)
    if len(measured) < FEWEST_FIXES:
        return None, f"{names}: {len(measured)} GNSS fixes do not place the map; {FEWEST_FIXES} do"
    T, weights = _turned_about_z(antennas, measured, sigma)
    spread = antennas[:, :2] - np.average(antennas[:, :2], axis=0, weights=weights)
    heading_rad = 1.0 / np.sqrt(max(float(np.sum(weights * np.sum(spread**2, axis=1) / sigma**2)), 1e-12))
    if heading_rad > HEADING_RAD:
        return None, (
            f"{names}: the GNSS fixes tell the map's heading to {np.degrees(min(heading_rad, np.pi)):.0f} degrees only,"
            " so it keeps its own frame; drive farther than they err"
        )  # fmt: skip
    off_m = float(np.median(np.linalg.norm((antennas @ T[:3, :3].T + T[:3, 3] - measured)[:, :2], axis=1)))
    size_m = float(np.median(np.linalg.norm(antennas[:, :2] - np.median(antennas[:, :2], axis=0), axis=1)))
    if off_m > max(STRANGE * size_m, float(np.median(sigma))):
        return None, (
            f"{names}: the GNSS fixes do not follow the path (half are {off_m:.0f} m off it, wherever it is put), so"
            " the map keeps its own frame; check order, signs and units of latitude and longitude, and the clock"
        )
    return T, ""


def _turned_about_z(points: FloatArray, measured: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`T_measured_points` of a turn about z and a move, and weights `(N,)`, by reweighted least squares."""
    weights = np.ones(len(points))
    for _ in range(ROUNDS):
        w = weights / sigma**2
        a, b = (values - np.average(values, axis=0, weights=w) for values in (points, measured))
        cross, dot = w @ (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), w @ np.sum(a[:, :2] * b[:, :2], axis=1)
        yaw = float(np.arctan2(cross, dot))
        R = Rotation.from_euler("z", yaw).as_matrix()
        t = np.average(measured - points @ R.T, axis=0, weights=w)
        off = np.linalg.norm((points @ R.T + t - measured)[:, :2], axis=1)
        scale = max(float(np.median(off)), float(np.median(sigma)))  # drift of the map is in it: the graph will mend it
        weights = 1.0 / (1.0 + (off / (CAUCHY_WIDTH * scale)) ** 2)
    return se3.from_rotation_translation(R, t), weights


def weights_of_up(up: UpDirections, T_world_body: FloatArray) -> FloatArray:
    """`(M,)` what the kernel leaves of each direction: 1 where it agrees with the estimate, 0 where it is far off."""
    off = up.angles_off(T_world_body[:, :3, :3]) / up.sigma_rad
    return np.asarray(1.0 / (1.0 + (off / CAUCHY_WIDTH) ** 2))


def weights_of_fixes(fixes: PositionFixes, T_world_body: FloatArray) -> FloatArray:
    """`(M,)` the same of positions."""
    off = np.linalg.norm((fixes.antennas(T_world_body) - fixes.position_enu) / fixes.sigma_enu, axis=1)
    return np.asarray(1.0 / (1.0 + (off / CAUCHY_WIDTH) ** 2))
