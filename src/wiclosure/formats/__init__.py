"""Files that users and other programs read and write."""

from typing import TYPE_CHECKING

from wiclosure.lazy import offer

if TYPE_CHECKING:
    from wiclosure.formats.candidates_csv import StampedPairs as StampedPairs
    from wiclosure.formats.candidates_csv import read_candidates as read_candidates
    from wiclosure.formats.candidates_csv import write_candidates as write_candidates
    from wiclosure.formats.radio.wireless_log import read_wireless_log as read_wireless_log
    from wiclosure.formats.radio.wireless_log_writer import write_wireless_log as write_wireless_log
    from wiclosure.formats.radio.wsr import AoaNoise as AoaNoise
    from wiclosure.formats.radio.wsr import read_wsr_matrix as read_wsr_matrix
    from wiclosure.formats.radio.wsr import read_wsr_profiles as read_wsr_profiles
    from wiclosure.formats.radio.wsr import wsr_wireless_log as wsr_wireless_log
    from wiclosure.formats.trajectories.kitti_poses import write_kitti_poses as write_kitti_poses
    from wiclosure.formats.trajectories.tum import read_tum as read_tum
    from wiclosure.formats.trajectories.tum import write_tum as write_tum
else:
    __getattr__, __dir__, __all__ = offer(
        __name__,
        {
            "wiclosure.formats.candidates_csv": "StampedPairs read_candidates write_candidates",
            "wiclosure.formats.trajectories.kitti_poses": "write_kitti_poses",
            "wiclosure.formats.trajectories.tum": "read_tum write_tum",
            "wiclosure.formats.radio.wireless_log": "read_wireless_log",
            "wiclosure.formats.radio.wireless_log_writer": "write_wireless_log",
            "wiclosure.formats.radio.wsr": "AoaNoise read_wsr_matrix read_wsr_profiles wsr_wireless_log",
        },
    )
