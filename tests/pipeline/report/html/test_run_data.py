from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.config import dump_config
from wiclosure.pipeline.report.html.packing import unpacked_array
from wiclosure.pipeline.report.html.run_data import run_data


@pytest.fixture(scope="module")
def data(lost_run):
    return run_data(lost_run)


def test_each_part_of_the_page_is_there(data, lost_run):
    assert data["name"] == "wiclosure"
    assert data["seconds"] == lost_run.metrics["seconds"]
    assert data["versions"]["numpy"] == np.__version__
    assert len(data["robots"]) == 3
    assert len(data["closures"]) == len(lost_run.solution.closures) == 16
    assert len(data["radio"]) == len(lost_run.solution.filtered.alignments) == 2
    assert {table["caption"] for table in data["tables"]} >= {"Closures", "Memory and radio traffic"}


def test_a_robot_that_nothing_connects_is_named(data, run_of):
    assert data["map_note"] == "Not connected, drawn beside the map in a frame of its own: gamma."
    assert run_data(run_of())["map_note"] == ""


def test_the_configuration_is_that_of_the_run(data, lost_run):
    assert data["config"] == dump_config(lost_run.config)


def test_another_frame_of_the_truth_draws_the_same(run_of):
    """Ground truth is laid over the estimate, wherever its own origin is."""
    run = run_of()
    T = se3.from_yaw(1.0, np.array([100.0, -50.0, 3.0]))
    robots = tuple(replace(robot, ground_truth=robot.ground_truth.moved(T)) for robot in run.inputs.robots)
    moved = run_data(replace(run, inputs=replace(run.inputs, robots=robots)))
    for found, expected in zip(moved["robots"], run_data(run)["robots"], strict=True):
        np.testing.assert_allclose(unpacked_array(found["truth"]), unpacked_array(expected["truth"]), atol=0.02)
        np.testing.assert_allclose(unpacked_array(found["truth"]), unpacked_array(found["merged"]), atol=0.02)


def test_robots_that_go_on_without_radio_have_their_measurements_and_the_reason_on_the_page(run_of):
    run = run_of()
    (one,) = [a for a in run.solution.filtered.alignments if (a.robot_a, a.robot_b) == ("alpha", "beta")]
    why = "alpha and beta: the radio is the likely fault (46 to 1)"
    left_out = replace(
        run.solution,
        filtered=replace(run.solution.filtered, alignments=()),
        contradictions=(why, "alpha and gamma: something else"),
        without_radio=(("alpha", "beta"),),
    )
    (pair,) = run_data(replace(run, solution=left_out))["radio"]
    assert not pair["certain"]
    assert pair["reason"] == "the radio is the likely fault (46 to 1)"
    heard = [m for m in run.inputs.wireless.measurements if {m.receiver, m.transmitter} == {"alpha", "beta"}]
    assert pair["measured"] == len(heard) > 0
    assert np.isfinite(unpacked_array(pair["estimate"])).all()
    still_used = replace(run.solution, contradictions=(why,))
    reasons = [pair["reason"] for pair in run_data(replace(run, solution=still_used))["radio"]]
    assert f"{one.reason}; the radio is the likely fault (46 to 1)" in reasons
