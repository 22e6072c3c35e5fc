"""Files that users and other programs read and write."""

from typing import TYPE_CHECKING

from wiclosure.lazy import offer

if TYPE_CHECKING:
    from wiclosure.formats.candidates_csv import StampedPairs as StampedPairs
    from wiclosure.formats.candidates_csv import read_candidates as read_candidates
    from wiclosure.formats.candidates_csv import write_candidates as write_candidates
    from wiclosure.formats.kitti_poses import write_kitti_poses as write_kitti_poses
    from wiclosure.formats.tum import read_tum as read_tum
    from wiclosure.formats.tum import write_tum as write_tum
    from wiclosure.formats.uwb_csv import RangeColumn as RangeColumn
    from wiclosure.formats.uwb_csv import UwbColumns as UwbColumns
    from wiclosure.formats.uwb_csv import read_uwb_csv as read_uwb_csv
    from wiclosure.formats.wireless_log import read_wireless_log as read_wireless_log
    from wiclosure.formats.wireless_log import write_wireless_log as write_wireless_log
    from wiclosure.formats.wsr import AoaNoise as AoaNoise
    from wiclosure.formats.wsr import read_wsr_matrix as read_wsr_matrix
    from wiclosure.formats.wsr import read_wsr_profiles as read_wsr_profiles
    from wiclosure.formats.wsr import wsr_wireless_log as wsr_wireless_log
else:
    __getattr__, __dir__, __all__ = offer(
        __name__,
        {
            "wiclosure.formats.candidates_csv": "StampedPairs read_candidates write_candidates",
            "wiclosure.formats.kitti_poses": "write_kitti_poses",
            "wiclosure.formats.tum": "read_tum write_tum",
            "wiclosure.formats.uwb_csv": "RangeColumn UwbColumns read_uwb_csv",
            "wiclosure.formats.wireless_log": "read_wireless_log write_wireless_log",
            "wiclosure.formats.wsr": "AoaNoise read_wsr_matrix read_wsr_profiles wsr_wireless_log",
        },
    )
