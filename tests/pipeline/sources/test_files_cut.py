from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.backends.config import MapSettings
from wiclosure.backends.merged.map_writers import write_ply
from wiclosure.backends.merged.merged_map import merge_maps
from wiclosure.errors import InputError
from wiclosure.pipeline.sources.open import open_source


@pytest.mark.parametrize("share", [0.1, 0.5, 0.7])
def test_a_cut_cloud_is_refused(tmp_path: Path, share: float) -> None:
    points = np.random.default_rng(0).uniform(1, 50, (5000, 3)).astype(np.float32)
    write_ply(merge_maps([(0, np.eye(4), points)], MapSettings()), tmp_path / "0.ply")
    assert len(next(iter(open_source(tmp_path))).points) > 4000
    whole = (tmp_path / "0.ply").read_bytes()
    (tmp_path / "0.ply").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"0\.ply is cut short"):
        list(open_source(tmp_path))
