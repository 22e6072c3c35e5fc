"""Worlds with known truth: scenes, LiDAR rays, radio."""

from wiclosure.simulation.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.simulation.scenario import Scenario
from wiclosure.simulation.scenarios import SCENARIOS, ScenarioSettings, make_scenario

__all__ = [
    "SCENARIOS",
    "RadioSettings",
    "Scenario",
    "ScenarioSettings",
    "make_scenario",
    "simulate_wireless_from_poses",
]
