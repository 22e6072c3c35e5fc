"""Milliseconds and points a simulated scan, for each LiDAR, in the demo's yard: `python benchmarks/raycast.py`."""

from __future__ import annotations

import time

import numpy as np

from wiclosure.simulation import ScenarioSettings, make_scenario
from wiclosure.simulation.sensors.lidar import LIDARS

SCANS = 20


def main() -> None:
    print(f"{'lidar':12} {'rays':>8} {'points':>8} {'ms (median)':>12} {'ms (casting alone)':>19}")
    for name, model in LIDARS.items():
        scenario = make_scenario("demo-site", ScenarioSettings.model_validate({"lidar": name}))
        source = scenario.scan_source("alpha")
        source.scan(0)  # builds the ray casting tree
        milliseconds, points = [], 0
        for index in range(SCANS):
            start = time.perf_counter()
            points += len(source.scan(index).points)
            milliseconds.append(1e3 * (time.perf_counter() - start))
        rays = np.zeros((model.columns * len(model.elevations_deg), 6), np.float32)
        rays[:, :3] = scenario.ground_truth("alpha").positions[0]
        rays[:, 3:] = model.directions.reshape(-1, 3)
        start = time.perf_counter()
        for _ in range(SCANS):
            scenario.scene.cast(rays)
        casting = 1e3 * (time.perf_counter() - start) / SCANS
        print(f"{name:12} {len(rays):8} {points // SCANS:8} {np.median(milliseconds):12.1f} {casting:19.1f}")


if __name__ == "__main__":
    main()
