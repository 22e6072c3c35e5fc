"""What is done with closures: consistency, pose graph, merged trajectories and map."""

from typing import TYPE_CHECKING

from wiclosure.lazy import offer

if TYPE_CHECKING:
    from wiclosure.backends.config import MapSettings as MapSettings
    from wiclosure.backends.config import PcmSettings as PcmSettings
    from wiclosure.backends.config import PoseGraphSettings as PoseGraphSettings
    from wiclosure.backends.g2o_reader import G2oTeam as G2oTeam
    from wiclosure.backends.g2o_reader import read_g2o as read_g2o
    from wiclosure.backends.g2o_writer import write_g2o as write_g2o
    from wiclosure.backends.graph_result import GraphResult as GraphResult
    from wiclosure.backends.map_writers import write_pcd as write_pcd
    from wiclosure.backends.map_writers import write_ply as write_ply
    from wiclosure.backends.merged_map import MergedMap as MergedMap
    from wiclosure.backends.merged_map import merge_maps as merge_maps
    from wiclosure.backends.pcm import IncrementalPcm as IncrementalPcm
    from wiclosure.backends.pcm import PcmResult as PcmResult
    from wiclosure.backends.pcm import pairwise_consistent as pairwise_consistent
    from wiclosure.backends.pose_graph import optimise as optimise
    from wiclosure.backends.streaming import StreamingBackEnd as StreamingBackEnd
else:
    __getattr__, __dir__, __all__ = offer(
        __name__,
        {
            "wiclosure.backends.config": "MapSettings PcmSettings PoseGraphSettings",
            "wiclosure.backends.g2o_reader": "G2oTeam read_g2o",
            "wiclosure.backends.g2o_writer": "write_g2o",
            "wiclosure.backends.graph_result": "GraphResult",
            "wiclosure.backends.map_writers": "write_pcd write_ply",
            "wiclosure.backends.merged_map": "MergedMap merge_maps",
            "wiclosure.backends.pcm": "IncrementalPcm PcmResult pairwise_consistent",
            "wiclosure.backends.pose_graph": "optimise",
            "wiclosure.backends.streaming": "StreamingBackEnd",
        },
    )
