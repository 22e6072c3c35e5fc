"""A car that drives through a yard leaves the map; walls stay."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.frontends.moving_objects import standing


def walls(rng):
    """Points of a square yard's walls, 15 m away on all sides."""
    along, height = rng.uniform(-15, 15, 6000), rng.uniform(-1.5, 3.0, 6000)
    side = rng.integers(0, 4, 6000)
    sign = np.where(side < 2, 15.0, -15.0)
    x, y = np.where(side % 2 == 0, sign, along), np.where(side % 2 == 0, along, sign)
    return np.column_stack([x, y, height])


def car(rng, at):
    return np.asarray(at) + rng.uniform([-2, -0.9, -1.0], [2, 0.9, 0.5], (300, 3))


@pytest.fixture
def drive():
    """Clouds and poses of a robot that creeps while a car passes, and which points are the car's."""
    rng = np.random.default_rng(0)
    poses = se3.from_yaw(np.linspace(0, 0.3, 30), np.column_stack([np.linspace(-1, 1, 30), np.zeros(30), np.zeros(30)]))
    clouds, is_car = [], []
    for k, pose in enumerate(poses):
        yard, passing = walls(rng), car(rng, [-11 + 0.8 * k, 7.0, 0.0])
        hidden = np.abs(np.arctan2(yard[:, 1], yard[:, 0]) - np.arctan2(7.0, -11 + 0.8 * k)) < 0.25
        world = np.concatenate([yard[~hidden], passing])
        clouds.append(se3.transform(se3.inverse(pose), world).astype(np.float32))
        is_car.append(np.arange(len(world)) >= (~hidden).sum())
    return clouds, poses, is_car


def test_the_car_leaves_and_the_walls_stay(drive):
    clouds, poses, is_car = drive
    left = list(standing(clouds, poses, 0.25))
    gone_car = gone_wall = cars = yard = 0
    for stays, of_car in zip(left, is_car, strict=True):
        gone_car, gone_wall = gone_car + (~stays & of_car).sum(), gone_wall + (~stays & ~of_car).sum()
        cars, yard = cars + of_car.sum(), yard + (~of_car).sum()
    assert gone_car > 0.8 * cars
    assert gone_wall < 0.005 * yard


def test_one_cloud_alone_stays_whole(drive):
    clouds, poses, _ = drive
    (left,) = standing(clouds[:1], poses[:1], 0.25)
    assert left.all()
