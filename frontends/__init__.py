"""What is done with scans: odometry, keyframes, place recognition, registration."""

from typing import TYPE_CHECKING

from wiclosure.lazy import offer

if TYPE_CHECKING:
    from wiclosure.frontends.config import IntraRobotLoopSettings as IntraRobotLoopSettings
    from wiclosure.frontends.config import KeyframeSettings as KeyframeSettings
    from wiclosure.frontends.config import MatchingSettings as MatchingSettings
    from wiclosure.frontends.config import OdometrySettings as OdometrySettings
    from wiclosure.frontends.config import RegistrationSettings as RegistrationSettings
    from wiclosure.frontends.config import ScanContextSettings as ScanContextSettings
    from wiclosure.frontends.front_end import OdometryRun as OdometryRun
    from wiclosure.frontends.front_end import describe_all as describe_all
    from wiclosure.frontends.front_end_result import Descriptors as Descriptors
    from wiclosure.frontends.front_end_result import FrontEndResult as FrontEndResult
    from wiclosure.frontends.front_end_result import OdometryResult as OdometryResult
    from wiclosure.frontends.odometry.registry import ODOMETRIES as ODOMETRIES
    from wiclosure.frontends.odometry.registry import make_odometry as make_odometry
    from wiclosure.frontends.place_recognition.matching import MatchResult as MatchResult
    from wiclosure.frontends.place_recognition.matching import match as match
    from wiclosure.frontends.place_recognition.scan_context import describe as describe
    from wiclosure.frontends.registration.methods import METHODS as METHODS
    from wiclosure.frontends.registration.methods import RegistrationMethod as RegistrationMethod
    from wiclosure.frontends.registration.registration import Registration as Registration
else:
    __getattr__, __dir__, __all__ = offer(
        __name__,
        {
            "wiclosure.frontends.config": (
                "IntraRobotLoopSettings KeyframeSettings MatchingSettings OdometrySettings "
                "RegistrationSettings ScanContextSettings"
            ),
            "wiclosure.frontends.front_end": "OdometryRun describe_all",
            "wiclosure.frontends.front_end_result": "Descriptors FrontEndResult OdometryResult",
            "wiclosure.frontends.place_recognition.matching": "MatchResult match",
            "wiclosure.frontends.odometry.registry": "ODOMETRIES make_odometry",
            "wiclosure.frontends.registration.registration": "Registration",
            "wiclosure.frontends.registration.methods": "METHODS RegistrationMethod",
            "wiclosure.frontends.place_recognition.scan_context": "describe",
        },
    )
