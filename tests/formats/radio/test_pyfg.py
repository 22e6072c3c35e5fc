"""Factor graphs of PyFactorGraph: ranges between robots, to landmarks, and malformed ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.errors import InputError
from wiclosure.formats.radio.pyfg import PyfgRange, read_pyfg_ranges

GRAPH = """\
VERTEX_SE2 0.100000000 A0 0.000000 0.000000 0.0000000
VERTEX_XY L0 2.500000 0.500000
EDGE_SE2 0.1 A0 A1 1.033099 0.093536 0.4499639 0.01 0.0 0.0 0.01 0.0 0.04
EDGE_RANGE 2.123456789 A2 B15 0.853187 0.010000
EDGE_RANGE 6.1 A6 L0 0.8 0.01
EDGE_RANGE 6.1 A6
EDGE_RANGE 6.1 17 3 0.8 0.01
"""


def test_ranges(tmp_path: Path) -> None:
    (tmp_path / "a.pyfg").write_text(GRAPH)
    between, landmark, short, unnamed = read_pyfg_ranges(tmp_path / "a.pyfg")
    assert between == PyfgRange(4, "2.123456789", "A", "B", "0.853187", "0.010000")
    assert landmark.transmitter == "L0"
    assert short.problem is not None
    assert unnamed.problem is not None


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        list(read_pyfg_ranges(tmp_path / "gone"))
