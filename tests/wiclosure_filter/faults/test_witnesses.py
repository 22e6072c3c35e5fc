"""What two robots measured of each other refutes an estimate that joins them by a third and is wrong."""

from __future__ import annotations

import pytest

from wiclosure import se3
from wiclosure.types import WirelessLog
from wiclosure.wiclosure_filter.faults import witnesses
from wiclosure.wiclosure_filter.filter import WiClosureFilter

from .test_diagnosis import heard, team


def heard_elsewhere(metres: float) -> tuple[WiClosureFilter, tuple]:
    """Three robots, of which b and c measured each other as if b were so far away."""
    odometry, truth = team("abc")
    displaced = {**truth, "b": se3.from_yaw(0.0, [metres, 0.0, 0.0]) @ truth["b"]}
    measurements = [m for m in heard(truth).measurements if {m.receiver, m.transmitter} != {"b", "c"}]
    measurements += [m for m in heard(displaced).measurements if {m.receiver, m.transmitter} == {"b", "c"}]
    chosen = WiClosureFilter()
    links = chosen.gather(odometry, WirelessLog(tuple(measurements))).by_pair
    alignments = chosen.align(odometry, links)
    assert not any(alignment.ambiguous for alignment in alignments.values())
    return chosen, (odometry, links, alignments)


@pytest.mark.parametrize(("metres", "refuted"), [(0.0, set()), (12.0, {("a", "c"), ("b", "c")})])
def test_a_doubted_pair_refutes_what_no_cycle_confirms(metres: float, refuted: set[tuple[str, str]]) -> None:
    chosen, (odometry, links, alignments) = heard_elsewhere(metres)
    alignments["a", "b"] = alignments["a", "b"].doubted("a slip")
    shared = chosen.share(odometry, links, list(alignments.values()))
    assert set(witnesses.refuted(shared, alignments, links, odometry, chosen.settings.alignment)) == refuted
    left = chosen.shared(odometry, links, alignments)[1]
    assert {pair for pair, alignment in left.items() if not alignment.ambiguous} == {("a", "c"), ("b", "c")} - refuted


def test_an_estimate_of_all_measurements_has_no_witness() -> None:
    chosen, (odometry, links, alignments) = heard_elsewhere(0.0)
    shared = chosen.share(odometry, links, list(alignments.values()))
    assert witnesses.refuted(shared, alignments, links, odometry, chosen.settings.alignment) == {}
