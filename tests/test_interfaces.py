"""What implements an interface has all of its methods, with parameters of the same names in the same order."""

from __future__ import annotations

import inspect

import pytest

from wiclosure.frontends.odometry.kiss_odometry import KissOdometry
from wiclosure.frontends.odometry.recorded_odometry import RecordedOdometry
from wiclosure.interfaces import CandidateFilter, Odometry, ScanSource
from wiclosure.pipeline.sources.folder import FolderSource
from wiclosure.pipeline.sources.kitti import KittiSource
from wiclosure.pipeline.sources.rosbag import RosbagSource
from wiclosure.simulation.scenario import SimulatedScans
from wiclosure.wiclosure_filter.baselines import NoFilter, OracleFilter, RandomFilter, RangeGateFilter
from wiclosure.wiclosure_filter.filter import WiClosureFilter

IMPLEMENTATIONS = {
    ScanSource: (RosbagSource, KittiSource, FolderSource, SimulatedScans),
    Odometry: (KissOdometry, RecordedOdometry),
    CandidateFilter: (WiClosureFilter, NoFilter, OracleFilter, RandomFilter, RangeGateFilter),
}
MEMBERS = [
    (implementation, interface, name)
    for interface, implementations in IMPLEMENTATIONS.items()
    for implementation in implementations
    for name, member in vars(interface).items()
    if (not name.startswith("_") or name in {"__len__", "__iter__"}) and callable(member)
]


@pytest.mark.parametrize(("implementation", "interface", "name"), MEMBERS)
def test_a_method_is_there_and_called_as_the_interface_says(implementation, interface, name):
    asked, found = getattr(interface, name), getattr(implementation, name)
    assert list(inspect.signature(found).parameters) == list(inspect.signature(asked).parameters)


def test_a_source_is_told_from_other_objects_at_run_time():
    scans = SimulatedScans("two scans", None, None, None, (0,), 2)
    assert isinstance(scans, ScanSource)
    assert not isinstance([], ScanSource)
    assert not isinstance(NoFilter(), ScanSource)
