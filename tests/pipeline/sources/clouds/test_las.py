from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.clouds.las import read_las


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize(("point_format", "timed"), [(0, False), (1, True)])
def test_points_times_and_intensity_are_read_back(tmp_path: Path, suffix: str, point_format: int, timed: bool) -> None:
    laspy = pytest.importorskip("laspy")
    rng = np.random.default_rng(0)
    made = laspy.create(point_format=point_format, file_version="1.2")
    made.header.scales = [0.001] * 3
    points = np.round(rng.normal(0, 30, (50, 3)), 3)
    made.x, made.y, made.z = points.T
    made.intensity = np.arange(50)
    if timed:
        made.gps_time = np.linspace(100.0, 100.1, 50)
    made.write(tmp_path / f"a{suffix}")
    cloud = read_las(tmp_path / f"a{suffix}")
    np.testing.assert_allclose(cloud.points, points, atol=1e-9)
    np.testing.assert_array_equal(cloud.intensity, np.arange(50))
    if timed:
        np.testing.assert_array_equal(cloud.times, np.linspace(100.0, 100.1, 50))
    else:
        assert cloud.times is None


def test_what_cannot_be_read_and_a_missing_library_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.las").write_bytes(b"LASF" + bytes(50))
    with pytest.raises(InputError, match=r"a\.las"):
        read_las(tmp_path / "a.las")
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(
        InputError, match=r"a\.las: LAS files need laspy; install it \(pip install 'wiclosure\[las\]'\)"
    ):
        read_las(tmp_path / "a.las")
