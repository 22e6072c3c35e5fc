"""The contents of `metrics.json`, typed.

`None` stands where there is no ground truth, or one without the orientations needed, or nothing to divide by.
"""

from __future__ import annotations

from typing import NotRequired, TypedDict


class CandidateMetrics(TypedDict):
    """Kept pairs of keyframes against those that are truly within a radius, over pairs with ground truth.

    `false_rejected` is the share of the false pairs that was left out; `pruned`, the share of all that was, needs no
    ground truth.
    """

    radius_m: float
    true: int | None
    false: int | None
    kept_true: int | None
    kept_false: int | None
    precision: float | None
    recall: float | None
    false_rejected: float | None
    pruned: float | None


class ClosureMetrics(TypedDict):
    """How many closures came how far; true and false by ground truth, of those that have it.

    `verified`: let through by registration and the radio check, which the funnel counts one by one.
    """

    proposed: int
    verified: int
    accepted: int
    verified_true: int | None
    verified_false: int | None
    accepted_true: int | None
    accepted_false: int | None


class StageCount(TypedDict):
    """How many candidates are left after a stage, and how many of them are true and false; see `funnel.py`."""

    stage: str
    count: int
    true: int | None
    false: int | None


class AlignmentMetrics(TypedDict):
    """Where the merged result puts one robot relative to another, against ground truth."""

    translation_error_m: float | None
    rotation_error_deg: float | None
    ambiguous: bool | None


class RadioMetrics(TypedDict):
    """What the radio told of how two robots' odometry frames lie.

    Sigmas are those of the frame of b in that of a; None where no alignment was found. `links_used`: measurements that
    the kept pairs rest on; None where the alignment was not used.
    """

    certain: bool
    reason: str
    yaw_sigma_deg: float | None
    horizontal_sigma_m: float | None
    height_sigma_m: float | None
    measurements_explained: int | None
    links_used: int | None


class StartMetrics(TypedDict):
    """The merged result's first pose of robot b in that of robot a."""

    x_m: float
    y_m: float
    z_m: float
    yaw_deg: float
    pitch_deg: float
    roll_deg: float


class RelativeErrorMetrics(TypedDict):
    """Root mean square error of relative poses: from one pose to the next, and over a distance."""

    step_m: float | None
    step_deg: float | None
    distance_m: float
    translation_m: float | None
    rotation_deg: float | None
    translation_percent: float | None


class ComponentMetrics(TypedDict):
    """Robots that accepted closures connect, and their error under one alignment."""

    robots: list[str]
    ate_m: float | None


class TrajectoryMetrics(TypedDict):
    """What can be said of merged trajectories alone.

    `ate_m` holds `team`, which is None unless all robots with ground truth are connected, and one value per robot under
    the alignment of its component; `ate_horizontal_m` the same without heights, which odometry without gravity holds
    worst; `ate_own_m` has each robot aligned on its own, which hides errors between robots.
    """

    ate_m: dict[str, float | None]
    ate_horizontal_m: dict[str, float | None]
    ate_own_m: dict[str, float | None]
    components: list[ComponentMetrics]
    rpe: dict[str, RelativeErrorMetrics]
    alignment: dict[str, AlignmentMetrics]
    diagnosis: list[str]


class WorkerMetrics(TypedDict):
    """A cluster's part in a run and those before it: workers used, work done again after deaths, bytes out and in."""

    used: int
    retries: int
    bytes_moved: int


class CostMetrics(TypedDict):
    """What a run took: wall time per stage, bytes between the robots, memory; and what a cluster did, if there was one.

    `seconds` is what the run costs from raw scans; `seconds_spent` what it really spent, with stages taken from a cache
    or another arm.
    """

    seconds: dict[str, float]
    seconds_spent: dict[str, float]
    bytes_exchanged: int | None
    peak_rss_mb: float | None
    workers: NotRequired[WorkerMetrics]


class UpMetrics(TypedDict):
    """Directions up of one robot: how many, how sure each is, and how many the estimate outvotes."""

    count: int
    sigma_deg: float
    outvoted: int


class FixMetrics(TypedDict):
    """Positions on the Earth of one robot: how many, and how many the estimate outvotes."""

    count: int
    outvoted: int


class EarthMetrics(TypedDict):
    """The world's frame, and what is known of the Earth.

    `frame`: `east-north-up` of `origin` (latitude and longitude in degrees, height in metres), `upright` where z points
    up, or `odometry` of the first robot.
    """

    frame: str
    origin: dict[str, float] | None
    placed: list[str]
    up: dict[str, UpMetrics]
    fixes: dict[str, FixMetrics]


class Metrics(TrajectoryMetrics, CostMetrics):
    """All of `metrics.json`.

    `ate_odometry_m` has each robot's plain odometry aligned on its own, and under `team` the error over all robots:
    what drift leaves to anyone who places the robots perfectly but mends nothing within them.  `doubts`: why the map
    may be wrong, one sentence for each two robots of which sets of closures contradict each other, or whose scans
    fit as well otherwise, and for odometry that may jump; mostly empty.
    """

    filter: str
    pairs_total: int
    pairs_kept: int
    candidates: CandidateMetrics
    candidates_registrable: CandidateMetrics
    closures: ClosureMetrics
    funnel: list[StageCount]
    radio: dict[str, RadioMetrics]
    starts: dict[str, StartMetrics]
    ate_odometry_m: dict[str, float | None]
    earth: EarthMetrics | None
    doubts: list[str]
