"""Arms over small recordings and worlds: what is shared, what is written, and what tables and pictures say."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wiclosure.pipeline.cli.compare import make_plan
from wiclosure.pipeline.cli.options import Configuration, RecordingOptions
from wiclosure.pipeline.comparison.arms import compare
from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.types import Scan

pytestmark = pytest.mark.usefixtures("coarse")

YARD = ["scenario:demo-site,lidar=vlp16,seed=3"]
SITE = Configuration(config="small-site", set_=["odometry.num_threads=1"])


def room_scans() -> list[Scan]:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (3000, 3)) * [10, 8, 3]
    wall = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), wall] = np.sign(points[np.arange(len(points)), wall]) * np.array([10, 8, 3])[wall]
    return [Scan(10**9 + k * 10**8, points) for k in range(3)]


# ------------------------------------------------------------------------------------------------------------ running
@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> tuple[Comparison, Path]:
    """One place seen by two robots, twice the same settings under two names."""
    folder = tmp_path_factory.mktemp("rooms")
    for robot in ("alpha", "beta"):
        write_kitti_folder(folder / robot, room_scans(), T_world_lidar=np.tile(np.eye(4), (3, 1, 1)))
    (folder / "again.yaml").write_text("{}")
    (folder / "out").mkdir()
    data = [f"{robot}={folder / robot}" for robot in ("alpha", "beta")]
    presets = f"strong,{folder / 'again.yaml'}"
    plan = make_plan(data, "none,oracle", presets, configuration=Configuration(), reading=RecordingOptions())
    compared = compare(plan, folder / "out", cache=StageCache(None), jobs=1, progress=NoProgress())
    return compared, folder / "out"


def test_what_is_equal_is_computed_once_and_charged_to_every_arm(rooms: tuple[Comparison, Path]) -> None:
    first, again = (rooms[0].arms[preset, "none"][0].metrics for preset in ("strong", "again"))
    assert first["closures"]["verified"] == again["closures"]["verified"] == 1
    for stage in ("odometry", "descriptors", "verification"):
        assert first["seconds"][stage] == again["seconds"][stage] > 0
    assert first["seconds_spent"].keys() == again["seconds_spent"].keys() == first["seconds"].keys()
    assert first["seconds_spent"]["odometry"] == first["seconds"]["odometry"]
    assert again["seconds_spent"]["odometry"] == again["seconds_spent"]["descriptors"] == 0
    assert again["seconds_spent"]["verification"] < first["seconds"]["verification"] / 2
    written = [json.loads((rooms[1] / o.folder / "metrics.json").read_text())["peak_rss_mb"] for o in rooms[0].outcomes]
    assert written[0] > 0
    assert set(written[1:]) == {None}


def test_every_arm_has_its_run_folder_and_shared_pictures_lie_beside_them(rooms: tuple[Comparison, Path]) -> None:
    compared, folder = rooms
    for outcome in compared.outcomes:
        assert outcome.folder == Path(outcome.preset, outcome.filter)
        written = json.loads((folder / outcome.folder / "metrics.json").read_text())
        assert written["seconds"] == outcome.metrics["seconds"]
        assert (folder / outcome.folder / "map.ply").is_file()
        assert (folder / outcome.preset / "trajectories.png").is_file()


@pytest.mark.slow
def test_worlds_differ_by_seed_and_random_keeps_what_wiclosure_kept(tmp_path: Path) -> None:
    plan = make_plan(YARD, "random,wiclosure", seeds=2, configuration=SITE, reading=RecordingOptions(n_scans=12))
    assert [world.seed for world in plan.worlds] == [3, 4]
    compared = compare(plan, tmp_path, cache=StageCache(None), jobs=1, progress=NoProgress())
    assert [(o.filter, o.seed) for o in compared.outcomes] == [
        ("random", 3), ("random", 4), ("wiclosure", 3), ("wiclosure", 4)
    ]  # fmt: skip
    for seed in (3, 4):
        random, chosen = (
            next(o.metrics for o in compared.arms["small-site", name] if o.seed == seed)
            for name in ("random", "wiclosure")
        )
        assert random["pairs_total"] > 0
        assert abs(random["pairs_kept"] - chosen["pairs_kept"]) <= 1
        assert (tmp_path / f"seed-{seed}" / "random" / "config.yaml").is_file()
    first, second = (o.metrics["ate_odometry_m"]["team"] for o in compared.arms["small-site", "wiclosure"])
    assert first != second
