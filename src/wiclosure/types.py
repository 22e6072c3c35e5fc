"""The nouns that all packages share, and the one place to import them from.

Frozen dataclasses that validate shapes and values when made.  `T_a_b` maps points of frame b into frame a; x forward, y
left, z up; metres and radians; time is integer nanoseconds.  Tangent vectors and covariances are ordered
`[rotation, translation]` and live in the second frame of the transform they belong to (see `wiclosure.se3`).
"""

from wiclosure.arrays import BoolArray, Float32Array, FloatArray, IntArray
from wiclosure.calibration import Calibration
from wiclosure.candidates import CandidatePairs, RelativePosePredictor, robot_pairs
from wiclosure.closure import Closure, KeyframeId, Stage, measured_poses, survivors
from wiclosure.earth import EarthMeasurements, GnssLog, PositionFixes, UpDirections
from wiclosure.evidence import (
    Measured,
    Prediction,
    PredictionKind,
    RegistrationEvidence,
    Residual,
    ScanContextMatch,
    capped_covariance,
)
from wiclosure.filter_result import ClosureCheck, FilterResult, RadioLinks
from wiclosure.frame_alignment import AlignmentFit, AlignmentHypothesis, FrameAlignment
from wiclosure.inertial import ImuLog
from wiclosure.scan import Scan
from wiclosure.trajectory import Trajectory, require_own_names
from wiclosure.wireless import (
    TURN_RAD,
    AoaFrame,
    AoaPath,
    Heading,
    RangeError,
    WirelessLog,
    WirelessMeasurement,
)

__all__ = [
    "TURN_RAD",
    "AlignmentFit",
    "AlignmentHypothesis",
    "AoaFrame",
    "AoaPath",
    "BoolArray",
    "Calibration",
    "CandidatePairs",
    "Closure",
    "ClosureCheck",
    "EarthMeasurements",
    "FilterResult",
    "Float32Array",
    "FloatArray",
    "FrameAlignment",
    "GnssLog",
    "Heading",
    "ImuLog",
    "IntArray",
    "KeyframeId",
    "Measured",
    "PositionFixes",
    "Prediction",
    "PredictionKind",
    "RadioLinks",
    "RangeError",
    "RegistrationEvidence",
    "RelativePosePredictor",
    "Residual",
    "Scan",
    "ScanContextMatch",
    "Stage",
    "Trajectory",
    "UpDirections",
    "WirelessLog",
    "WirelessMeasurement",
    "capped_covariance",
    "measured_poses",
    "require_own_names",
    "robot_pairs",
    "survivors",
]
