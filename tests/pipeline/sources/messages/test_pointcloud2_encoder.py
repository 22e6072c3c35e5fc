from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.pipeline.sources.messages.pointcloud2 import PointCloud2Decoder
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE, deserialize, serialize, typestore
from wiclosure.types import Scan

STAMP_NS = 1_700_000_000_123_456_789


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 60), timed=st.booleans(), bright=st.booleans())
def test_a_scan_is_read_back_from_its_bytes(encoding, seed, n, timed, bright):
    rng = np.random.default_rng(seed)
    scan = Scan(
        STAMP_NS,
        rng.normal(0, 20, (n, 3)).astype(np.float32).astype(float),
        np.sort(rng.uniform(0.0, 0.1, n)).astype(np.float32).astype(float) if timed else None,
        rng.uniform(size=n).astype(np.float32) if bright else None,
    )
    store = typestore(encoding)
    raw = bytes(serialize(store, encoding, encode_scan(scan, store, "velodyne"), POINT_CLOUD_TYPE))
    message = deserialize(store, encoding, raw, POINT_CLOUD_TYPE)
    assert message.header.frame_id == "velodyne"
    assert message.point_step == 4 * (3 + timed + bright)
    found = PointCloud2Decoder().decode(message, STAMP_NS)
    np.testing.assert_array_equal(found.points, scan.points)
    for name in ("times", "intensity"):
        if getattr(scan, name) is None:
            assert getattr(found, name) is None
        else:
            np.testing.assert_allclose(getattr(found, name), getattr(scan, name), atol=1e-9)
