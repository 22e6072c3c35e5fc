"""Worlds with known truth: scenes, LiDAR rays, radio."""

from wiclosure.simulation.scenario import Scenario
from wiclosure.simulation.scenarios.registry import SCENARIOS, ScenarioSettings, make_scenario
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.simulation.sensors.schedule import read_schedule

__all__ = [
    "SCENARIOS",
    "RadioSettings",
    "Scenario",
    "ScenarioSettings",
    "make_scenario",
    "read_schedule",
    "simulate_wireless_from_poses",
]
