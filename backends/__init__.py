"""What is done with closures: consistency, pose graph, merged trajectories and map."""

from typing import TYPE_CHECKING

from wiclosure.lazy import offer

if TYPE_CHECKING:
    from wiclosure.backends.config import MapSettings as MapSettings
    from wiclosure.backends.config import PcmSettings as PcmSettings
    from wiclosure.backends.config import PoseGraphSettings as PoseGraphSettings
    from wiclosure.backends.consistency.pcm import PcmResult as PcmResult
    from wiclosure.backends.consistency.pcm import pairwise_consistent as pairwise_consistent
    from wiclosure.backends.estimate.graph_result import GraphResult as GraphResult
    from wiclosure.backends.estimate.pose_graph import optimise as optimise
    from wiclosure.backends.estimate.streaming import StreamingBackEnd as StreamingBackEnd
    from wiclosure.backends.graph_files.g2o_writer import write_g2o as write_g2o
    from wiclosure.backends.graph_files.team import GraphTeam as GraphTeam
    from wiclosure.backends.graph_files.team import read_graphs as read_graphs
    from wiclosure.backends.merged.map_writers import write_pcd as write_pcd
    from wiclosure.backends.merged.map_writers import write_ply as write_ply
    from wiclosure.backends.merged.merged_map import MergedMap as MergedMap
    from wiclosure.backends.merged.merged_map import merge_maps as merge_maps
else:
    __getattr__, __dir__, __all__ = offer(
        __name__,
        {
            "wiclosure.backends.config": "MapSettings PcmSettings PoseGraphSettings",
            "wiclosure.backends.graph_files.g2o_writer": "write_g2o",
            "wiclosure.backends.graph_files.team": "GraphTeam read_graphs",
            "wiclosure.backends.estimate.graph_result": "GraphResult",
            "wiclosure.backends.merged.map_writers": "write_pcd write_ply",
            "wiclosure.backends.merged.merged_map": "MergedMap merge_maps",
            "wiclosure.backends.consistency.pcm": "PcmResult pairwise_consistent",
            "wiclosure.backends.estimate.pose_graph": "optimise",
            "wiclosure.backends.estimate.streaming": "StreamingBackEnd",
        },
    )
