"""Multi-robot LiDAR SLAM that asks the radio where the robots' paths meet.

Everything that users import is here: nouns, interfaces, and what is done with them.  Nothing is loaded before it is
asked for, so that `import wiclosure` costs a few milliseconds.
"""

from typing import TYPE_CHECKING

from wiclosure.lazy import offer
from wiclosure.version import __version__ as __version__

if TYPE_CHECKING:
    from wiclosure.backends import GraphResult as GraphResult
    from wiclosure.backends import PcmSettings as PcmSettings
    from wiclosure.backends import PoseGraphSettings as PoseGraphSettings
    from wiclosure.backends import StreamingBackEnd as StreamingBackEnd
    from wiclosure.backends import optimise as optimise
    from wiclosure.backends import pairwise_consistent as pairwise_consistent
    from wiclosure.drift import DriftModel as DriftModel
    from wiclosure.errors import ConfigError as ConfigError
    from wiclosure.errors import InputError as InputError
    from wiclosure.errors import OutputError as OutputError
    from wiclosure.errors import ProcessError as ProcessError
    from wiclosure.errors import WiclosureError as WiclosureError
    from wiclosure.formats import read_tum as read_tum
    from wiclosure.formats import read_wireless_log as read_wireless_log
    from wiclosure.formats import write_tum as write_tum
    from wiclosure.formats import write_wireless_log as write_wireless_log
    from wiclosure.interfaces import CandidateFilter as CandidateFilter
    from wiclosure.interfaces import Odometry as Odometry
    from wiclosure.interfaces import ScanSource as ScanSource
    from wiclosure.pipeline import Config as Config
    from wiclosure.pipeline import RunResult as RunResult
    from wiclosure.pipeline import load_config as load_config
    from wiclosure.pipeline import open_source as open_source
    from wiclosure.pipeline import run as run
    from wiclosure.simulation import ScenarioSettings as ScenarioSettings
    from wiclosure.simulation import make_scenario as make_scenario
    from wiclosure.types import AlignmentHypothesis as AlignmentHypothesis
    from wiclosure.types import AoaPath as AoaPath
    from wiclosure.types import CandidatePairs as CandidatePairs
    from wiclosure.types import Closure as Closure
    from wiclosure.types import ClosureCheck as ClosureCheck
    from wiclosure.types import FilterResult as FilterResult
    from wiclosure.types import FrameAlignment as FrameAlignment
    from wiclosure.types import Heading as Heading
    from wiclosure.types import KeyframeId as KeyframeId
    from wiclosure.types import Measured as Measured
    from wiclosure.types import Prediction as Prediction
    from wiclosure.types import PredictionKind as PredictionKind
    from wiclosure.types import RadioLinks as RadioLinks
    from wiclosure.types import RegistrationEvidence as RegistrationEvidence
    from wiclosure.types import RelativePosePredictor as RelativePosePredictor
    from wiclosure.types import Scan as Scan
    from wiclosure.types import ScanContextMatch as ScanContextMatch
    from wiclosure.types import Stage as Stage
    from wiclosure.types import Trajectory as Trajectory
    from wiclosure.types import WirelessLog as WirelessLog
    from wiclosure.types import WirelessMeasurement as WirelessMeasurement
    from wiclosure.wiclosure_filter import FilterSettings as FilterSettings
    from wiclosure.wiclosure_filter import make_filter as make_filter
else:
    __getattr__, __dir__, __all__ = offer(
        __name__,
        {
            "wiclosure.backends": (
                "GraphResult PcmSettings PoseGraphSettings StreamingBackEnd optimise pairwise_consistent"
            ),
            "wiclosure.drift": "DriftModel",
            "wiclosure.errors": "ConfigError InputError OutputError ProcessError WiclosureError",
            "wiclosure.formats": "read_tum read_wireless_log write_tum write_wireless_log",
            "wiclosure.interfaces": "CandidateFilter Odometry ScanSource",
            "wiclosure.pipeline": "Config RunResult load_config open_source run",
            "wiclosure.simulation": "ScenarioSettings make_scenario",
            "wiclosure.types": (
                "AlignmentHypothesis AoaPath CandidatePairs Closure ClosureCheck FilterResult "
                "FrameAlignment Heading KeyframeId Measured Prediction PredictionKind RadioLinks "
                "RegistrationEvidence RelativePosePredictor Scan ScanContextMatch Stage Trajectory "
                "WirelessLog WirelessMeasurement"
            ),
            "wiclosure.wiclosure_filter": "FilterSettings make_filter",
        },
    )
