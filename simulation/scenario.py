"""A simulated mission: robots that drive through a scene with LiDAR and radio."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wiclosure.errors import ConfigError
from wiclosure.simulation.names import lookup
from wiclosure.simulation.sensors.gnss import GnssSettings, simulate_gnss
from wiclosure.simulation.sensors.imu import ImuSettings, simulate_imu
from wiclosure.simulation.sensors.lidar import Individual, LidarModel, sweep
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless
from wiclosure.simulation.world.motion import START_NS, Motion
from wiclosure.simulation.world.scene import Scene
from wiclosure.simulation.world.traffic import Traffic
from wiclosure.types import BoolArray, FloatArray, GnssLog, ImuLog, IntArray, Scan, Trajectory, WirelessLog

_BODY_RADIUS_M = 0.3


@dataclass(frozen=True, eq=False)
class SimulatedScans:
    """The scans of one robot, cast one at a time; a `wiclosure.interfaces.ScanSource`.

    Args:
        description: one line for the user.
        scene, lidar, motion: what is seen, with what, from where.
        seed: makes the noise; scan k has the same noise however many scans are read before it.
        scans: how many.
        traffic: what moves there, or None.
    """

    description: str
    scene: Scene
    lidar: LidarModel
    motion: Motion
    seed: tuple[int, ...]
    scans: int
    traffic: Traffic | None = None

    def __len__(self) -> int:
        return self.scans

    def __iter__(self) -> Iterator[Scan]:
        for index in range(self.scans):
            yield self.scan(index)

    @cached_property
    def _individual(self) -> Individual:
        return self.lidar.individual(np.random.default_rng([*self.seed, 0]))

    def scan(self, index: int) -> Scan:
        """The scan of that index."""
        return self.labelled(index)[0]

    def labelled(self, index: int) -> tuple[Scan, BoolArray]:
        """The scan of that index, and `(N,)` which of its points are of what moves."""
        rng = np.random.default_rng([*self.seed, 1, index])
        stamp_ns = START_NS + index * self.lidar.period_ns
        return sweep(self._individual, self.scene, self.motion.T_world_body, stamp_ns, rng, self.traffic)


@dataclass(frozen=True, eq=False)
class Scenario:
    """A world with known truth: gives every robot's scans and trajectory, and all that the radio heard.

    Args:
        name: of the scenario.
        scene: the place.
        robots: each robot's motion by its name; the body frame is that of its LiDAR.
        lidar: that all robots carry.
        radio: how it behaves.
        seed: of all noise.
        imu: that all robots carry, or None.
        gnss: likewise.
        traffic: what moves besides the robots, or None.

    Raises:
        ConfigError: no robot, or a robot that drives through something.
    """

    name: str
    scene: Scene
    robots: Mapping[str, Motion]
    lidar: LidarModel
    radio: RadioSettings
    seed: int = 0
    imu: ImuSettings | None = None
    gnss: GnssSettings | None = None
    traffic: Traffic | None = None

    def __post_init__(self) -> None:
        if not self.robots:
            raise ConfigError(f"scenario {self.name} has no robots; ask for at least one")
        for robot, motion in self.robots.items():
            _refuse_collision(robot, motion, self.scene)

    def scan_source(self, robot: str) -> SimulatedScans:
        """The LiDAR of that robot."""
        motion = lookup("robot", robot, self.robots)
        return SimulatedScans(
            f"scenario {self.name}, robot {robot}: {self.lidar.name} simulated, seed {self.seed}",
            self.scene,
            self.lidar,
            motion,
            (self.seed, list(self.robots).index(robot)),
            motion.duration_ns // self.lidar.period_ns,
            self.traffic,
        )

    def ground_truth(self, robot: str) -> Trajectory:
        """True `T_world_body` at the start of every scan, and at the end of the last."""
        motion = lookup("robot", robot, self.robots)
        stamps_ns = START_NS + np.arange(motion.duration_ns // self.lidar.period_ns + 1) * self.lidar.period_ns
        return Trajectory(robot, stamps_ns, motion.T_world_body(stamps_ns))

    def wireless(self) -> WirelessLog:
        """All measurements between the robots, simulated in the scene."""
        truth = {robot: self.ground_truth(robot) for robot in self.robots}
        return simulate_wireless(truth, self.scene, self.radio, self.seed)

    def imu_log(self, robot: str) -> ImuLog | None:
        """What its IMU recorded, or None where robots have none."""
        motion = lookup("robot", robot, self.robots)
        rng = np.random.default_rng([self.seed, list(self.robots).index(robot), 2])
        return None if self.imu is None else simulate_imu(motion, self.imu, rng)

    def gnss_log(self, robot: str) -> GnssLog | None:
        """What its receiver gave, or None where robots have none."""
        motion = lookup("robot", robot, self.robots)
        rng = np.random.default_rng([self.seed, list(self.robots).index(robot), 3])
        return None if self.gnss is None else simulate_gnss(motion, self.gnss, rng)


def _refuse_collision(robot: str, motion: Motion, scene: Scene) -> None:
    stamps_ns = START_NS + np.arange(0, motion.duration_ns + 1, 200_000_000, dtype=np.int64)
    position = _spread(motion.T_world_body(stamps_ns)[:, :3, 3])
    # The ground is a surface too: half of the sensor's height above it is free.
    height = float(np.median(position[:, 2] - scene.ground.height(position[:, :2])))
    close = scene.clearance(position) < min(_BODY_RADIUS_M, 0.6 * height)
    through = np.append(scene.obstacles(position[:-1], position[1:]) > 0, False)
    if (close | through).any():
        x, y, _ = position[np.argmax(close | through)]
        raise ConfigError(f"the path of robot {robot} runs into something near ({x:.1f}, {y:.1f}); lead it around")


def _spread(position: FloatArray) -> FloatArray:
    """The positions where the robot moved since the last."""
    moved = np.linalg.norm(np.diff(position, axis=0), axis=1) > 0.01
    keep: IntArray = np.flatnonzero(np.append(True, moved))
    return position[keep]
