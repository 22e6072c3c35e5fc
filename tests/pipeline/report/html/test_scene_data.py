from __future__ import annotations

import numpy as np

from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.colours import ROBOT_COLOURS
from wiclosure.pipeline.report.html.packing import unpacked_array
from wiclosure.pipeline.report.html.scene_data import MAP_POINTS, Placement, fewer_points, map_entry, robot_entry
from wiclosure.types import Trajectory


def line(robot: str, n: int, start_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Trajectory:
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, 3] = start_m
    poses[:, 0, 3] += np.arange(n)
    return Trajectory(robot, np.arange(1, n + 1) * 10**9, poses)


def test_what_is_not_connected_is_drawn_beside() -> None:
    robots = {"a": line("a", 11, (1e6, 0, 0)), "b": line("b", 11, (1e6, 5, 0)), "c": line("c", 5)}
    placement = Placement.of((("a", "b"), ("c",)), robots)
    drawn = {name: robots[name].positions + placement.offset[name] for name in robots}
    np.testing.assert_allclose(np.concatenate([drawn["a"], drawn["b"]]).mean(axis=0), 0.0, atol=1e-6)
    assert drawn["c"][:, 0].min() > max(drawn["a"][:, 0].max(), drawn["b"][:, 0].max())
    assert placement.together("a", "b")
    assert not placement.together("a", "c")
    assert placement.connected == {"a", "b"}


def test_a_robot_keeps_both_ends_of_a_long_path() -> None:
    path = line("a", 40_000)
    entry = robot_entry(
        3, 10, path=path, odometry=path, keyframes=line("a", 7), placement=Placement.of((("a",),), {"a": path})
    )
    drawn = unpacked_array(entry["merged"])
    assert len(drawn) == 1_500
    np.testing.assert_allclose(drawn[[0, -1], 0], [-19_999.5, 19_999.5], atol=0.01)
    np.testing.assert_allclose(unpacked_array(entry["keyframe_times"]), np.arange(7))
    assert entry["colour"] == "#{:02x}{:02x}{:02x}".format(*ROBOT_COLOURS[3])
    assert entry["truth"] is None
    np.testing.assert_array_equal(unpacked_array(entry["odometry"])[0], 0.0)


def test_map_points_keep_their_robot() -> None:
    rng = np.random.default_rng(0)
    robot = rng.integers(0, 2, 3_000)
    points = rng.uniform(0, 10, (3_000, 3)) + robot[:, None] * [100, 0, 0]
    entry = map_entry(MergedMap(points.astype(np.float32), ROBOT_COLOURS[robot]), 2, np.array([-50.0, 0.0, 0.0]))
    assert entry is not None
    found = unpacked_array(entry["xyz"])
    np.testing.assert_array_equal(found[:, 0] > 0, unpacked_array(entry["robot"]) == 1)
    np.testing.assert_allclose(np.sort(found[:, 0]), np.sort(points[:, 0] - 50), atol=0.011)
    fewer = fewer_points(entry, 100)
    assert fewer is not None
    assert (fewer["shown"], fewer["of"]) == (100, 3_000)
    np.testing.assert_array_equal(unpacked_array(fewer["xyz"])[:, 0] > 0, unpacked_array(fewer["robot"]) == 1)
    assert fewer_points(entry, 3_000) is entry


def test_intensity_is_ranked_among_each_robots_points_whatever_its_unit() -> None:
    rng = np.random.default_rng(0)
    robot = rng.integers(0, 2, 2_000)
    height = rng.uniform(0, 10, 2_000)
    intensity = np.where(robot == 0, height / 10, height**4).astype(np.float32)  # 0 to 1; 0 to 10,000
    intensity[:5] = np.nan
    points = np.column_stack([100.0 * robot, rng.uniform(0, 50, 2_000), height]).astype(np.float32)
    merged = MergedMap(points, ROBOT_COLOURS[robot], intensity)
    entry = map_entry(merged, 2, np.zeros(3))
    assert entry is not None
    shade, drawn = unpacked_array(entry["intensity"]).astype(float), unpacked_array(entry["xyz"])
    assert np.count_nonzero(shade == 0) == 5
    known = shade > 0
    np.testing.assert_allclose(shade[known], drawn[known, 2] * 3.2, atol=2.5)
    fewer = fewer_points(entry, 100)
    assert fewer is not None
    assert len(unpacked_array(fewer["intensity"])) == 100
    alike = map_entry(MergedMap(points, ROBOT_COLOURS[robot], np.full(2_000, 7, np.float32)), 2, np.zeros(3))
    assert alike is not None
    assert alike["intensity"] is None


def test_large_maps_are_thinned_and_empty_ones_left_out() -> None:
    points = np.random.default_rng(0).uniform(0, 100, (MAP_POINTS + 1000, 3)).astype(np.float32)
    entry = map_entry(MergedMap(points, np.tile(ROBOT_COLOURS[0], (len(points), 1))), 1, np.zeros(3))
    assert entry is not None
    assert (entry["shown"], entry["of"]) == (MAP_POINTS, len(points))
    assert map_entry(MergedMap(points[:0], points[:0].astype(np.uint8)), 1, np.zeros(3)) is None
    assert fewer_points(None, 5) is None
