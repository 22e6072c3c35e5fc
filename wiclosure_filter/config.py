"""Settings of the filters: few numbers, the rest is derived from them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wiclosure.settings import Settings


class RadioModel(Settings):
    """What is assumed of ranges and bearings beyond the sigma that each measurement brings."""

    direct_path_absent: float = Field(
        0.15, gt=0.0, lt=1.0, description="probability that no reported path is the direct one; 0.15 in WSR data sets"
    )
    range_outlier: float = Field(0.05, gt=0.0, lt=1.0, description="probability of a gross range error")
    range_biased: float = Field(
        0.15, ge=0.0, lt=1.0, description="probability of a range through an obstacle, longer than the distance"
    )
    range_bias_m: float = Field(1.0, ge=0.0, description="m, mean and spread of that excess")
    range_reach_m: float = Field(200.0, gt=0.0, description="m, gross range errors spread this far")
    direct_path_absent_at_worst: float = Field(
        0.3, ge=0.0, lt=1.0, description="the same behind walls; 0.23 to 0.29 in WSR data sets without line of sight"
    )
    range_outlier_at_worst: float = Field(
        0.15, ge=0.0, lt=1.0, description="probability of a gross range error behind walls"
    )
    static_radius_m: float = Field(
        1.0,
        ge=0.0,
        description="m; measurements between antennas that moved less see one multipath situation, not many",
    )
    max_paths: int = Field(16, ge=1, description="strongest paths of a measurement that are considered")
    range_partner_s: float = Field(
        1.0, ge=0.0, description="s; a bearing without range borrows one measured within this time for its proposals"
    )


class AmbiguitySettings(Settings):
    """When an alignment must not be used to prune."""

    min_odds: float = Field(
        20.0, gt=1.0, description="odds against all different alignments below which the best is not certain"
    )
    min_redundancy: float = Field(
        1.5,
        ge=0.0,
        description="measured numbers beyond those that the alignment needs; a chance agreement has few to spare",
    )
    min_fit_probability: float = Field(
        0.01,
        ge=0.0,
        lt=1.0,
        description="chance that an honest radio behind walls agrees as little as an alignment that may be certain; 0:"
        " never asked",
    )
    weigh_blunders: bool = Field(
        True,
        description="where robots moved so that turned or mirrored azimuths, swapped names, or ranges in feet would fit"
        " as well: count these against a certain alignment",
    )
    max_yaw_sigma_rad: float = Field(0.35, gt=0.0, description="rad; beyond it errors are no longer Gaussian")
    max_relative_sigma: float = Field(
        0.25, gt=0.0, description="position sigma at the links over the distance of the links; beyond it likewise"
    )
    same_place_fraction: float = Field(
        0.15,
        gt=0.0,
        description="alignments that differ by less (over the links' distance) are one, where the covariance covers it",
    )


class CalibrationPriors(Settings):
    """How large constant errors usually are (standard deviations); those beyond three of them are faults."""

    blunder_share: float = Field(
        0.02, ge=0.0, lt=1.0, description="share of logs in which one of these errors is ten times as large as usual"
    )

    range_bias_m: float = Field(0.3, gt=0.0, description="m, of UWB ranges: antenna delays (0.35 in recordings)")
    range_scale: float = Field(
        0.01, gt=0.0, description="ratio by which ranges are longer than both odometries have them: that of their scale"
    )
    clock_s: float = Field(0.1, gt=0.0, description="s between two robots' clocks: network time over a busy radio")
    mounting_rad: float = Field(0.05, gt=0.0, description="rad, by which an antenna array is mounted turned")
    scale: float = Field(
        0.01, gt=0.0, description="ratio by which odometry is too long or too short: 0.5 % of LiDAR, 1 to 2 % of wheels"
    )


class AlignmentSettings(Settings):
    """How two odometry frames are aligned from what the robots heard of each other."""

    radio: RadioModel = RadioModel()
    heading: Literal["auto", "heading", "reciprocal", "one-way", "range-only"] = Field(
        "auto", description="knowledge of relative heading; auto takes the strongest that the log holds"
    )
    multipath: Literal["consensus", "pcm"] = Field(
        "consensus",
        description="consensus scores frame transforms against all measurements; pcm is the paper's pairwise method",
    )
    gravity_aligned: bool = Field(
        True, description="true: odometry z points up, yaw and translation are sought; false: all of SE(3)"
    )
    stamp_tolerance_s: float = Field(
        0.2,
        ge=0.0,
        description="s, about a scan; measurements further outside a trajectory's time are left out and counted",
    )
    reciprocal_tolerance_s: float = Field(
        1.0, ge=0.0, description="s between the two directions of a reciprocal bearing"
    )
    heading_tolerance_s: float = Field(5.0, ge=0.0, description="s between a measurement and the headings used with it")
    height_sigma_m: float = Field(
        10.0, gt=0.0, description="m; prior on the difference in height of robots that the radio does not tell, at most"
    )
    height_ratio: float = Field(
        0.02,
        gt=0.0,
        description="the same prior over the distance, at least: the ground's slope where odometry has seen none",
    )
    height_floor_m: float = Field(
        0.5, gt=0.0, description="m, the same prior for robots side by side: kerbs, ramps, antennas on other masts"
    )
    tilt_sigma_rad: float = Field(
        0.3, gt=0.0, description="rad; prior on roll and pitch between the frames, where gravity_aligned is false"
    )
    drift_inflation: float = Field(
        1.5, gt=0.0, description="factor on the odometry's standard deviations, since drift models are optimistic"
    )
    max_measurements: int = Field(
        400, ge=8, description="measurements of a pair of robots that are looked at; denser ones repeat each other"
    )
    proposals: int = Field(6_000, ge=100, description="frame transforms that are scored, at most")
    pcm_confidence: float = Field(
        0.95, gt=0.0, lt=1.0, description="quantile of chi-square below which a pair of links is consistent"
    )
    max_pcm_links: int = Field(600, ge=2, description="links in the consistency graph; the most certain are kept")
    guard: AmbiguitySettings = AmbiguitySettings()
    calibration: CalibrationPriors = CalibrationPriors()


class SharedTrajectorySettings(Settings):
    """How the trajectories of all robots are brought together."""

    method: Literal["joint", "shortest"] = Field(
        default="joint",
        description="joint: one estimate over all robots and all accepted links;"
        " shortest: each pair of poses through the one link with the shortest route (paper, eq. 13)",
    )
    node_spacing_m: float = Field(
        default=60.0,
        gt=0,
        description="m of road between poses of the joint estimate, besides those at links; the poses between follow"
        " the odometry, whose drift about the straight blend of both ends is far below the radio's error",
    )
    node_turn_rad: float = Field(
        default=0.7, gt=0, description="rad of turning that call for another pose: between poses the road is straight"
    )
    most_links: int = Field(
        default=150,
        ge=1,
        description="links in the joint estimate; of more, evenly many are taken, since neighbouring ones repeat each"
        " other",
    )
    least_links: int = Field(
        default=8,
        ge=1,
        description="links of each pair of robots in the joint estimate, at least, however many pairs there are: twice"
        " the unknowns of their alignment",
    )
    gravity_sigma_rad: float = Field(
        default=0.05,
        gt=0,
        description="rad, tilt of an odometry frame that counts as gravity-aligned (3 degrees: a car on a slope)",
    )
    drift_weight: float = Field(
        default=2.0,
        gt=0,
        description="the drift model is scaled by how well the links fit the odometry: it counts as so many of the"
        " parameters that links determine (2: drift differs 1.6-fold between recordings; 1e9: never scaled)",
    )
    robust_threshold: float = Field(
        default=2.385,
        gt=0,
        description="Cauchy kernel on ranges and bearings, in standard deviations (95 % efficient without outliers)",
    )


class GateSettings(Settings):
    """Which pairs are near enough to be compared."""

    method: Literal["overlap_probability", "mahalanobis"] = Field(
        default="overlap_probability",
        description="overlap_probability: the pair is within sensor_range_m with at least min_probability;"
        " mahalanobis: the paper's gate (eq. 7), which asks whether the two places may be the same",
    )
    sensor_range_m: float = Field(
        default=35.0,
        gt=0,
        description="m, R_sensor: two scans taken this far apart still overlap (paper: 20 % at 30 m range)",
    )
    min_probability: float = Field(
        default=0.05,
        gt=0,
        lt=1,
        description="a pair is kept where its chance of overlap is at least this: missing a true pair is taken to cost"
        " as much as comparing 20 pairs for nothing",
    )
    mahalanobis_threshold: float = Field(
        default=3.0, gt=0, description="D of the paper's gate, in standard deviations of the displacement"
    )
    budget: int | None = Field(
        default=None,
        ge=1,
        description="keep at most so many pairs a robot pair, the most probable first; null: no limit",
    )


class RandomSettings(Settings):
    """Random choice of pairs."""

    keep_rate: float = Field(default=0.01, ge=0, le=1, description="share of pairs that is kept")
    seed: int = Field(default=0, ge=0, description="the same seed keeps the same pairs")


class OracleSettings(Settings):
    """Choice by ground truth."""

    radius_m: float = Field(
        default=35.0, gt=0, description="m, pairs nearer than this are kept (the paper's true pairs)"
    )


class RangeGateSettings(Settings):
    """Choice by UWB range alone."""

    max_range_m: float = Field(default=35.0, gt=0, description="m, ranges up to this propose pairs (scans overlap)")
    window_m: float = Field(
        default=35.0, gt=0, description="m travelled before and after the measurement that are proposed on both robots"
    )


class FilterSettings(Settings):
    """Everything that `make_filter` needs."""

    alignment: AlignmentSettings = AlignmentSettings()
    shared_trajectory: SharedTrajectorySettings = SharedTrajectorySettings()
    gate: GateSettings = GateSettings()
    on_ambiguous: Literal["pass", "reject", "raise"] = Field(
        default="pass",
        description="where the radio cannot tell how two robots' frames lie: keep the pairs that the few likely"
        " alignments allow, or every pair if they are many (pass); keep none (reject); or stop with an error (raise)",
    )
    closure_odds: float | None = Field(
        default=100.0,
        gt=1,
        description="radio consistency check: registered closures of robots whose poses the radio does not predict are"
        " rejected where the links give these odds against the alignment that they imply; null: none are (the paper)."
        " Needs level frames, and robots that heard each other. Where odometry drifts as its model says, 98 % of the"
        " true ones or more stay below",
    )
    accept_correction: bool = Field(
        default=False,
        description="where a systematic error of the log explains the measurements far better than what the log claims"
        " (azimuths clockwise, ranges in feet, clocks apart), by the filter or the merged map: correct it, and go on;"
        " false: name it only",
    )
    random: RandomSettings = RandomSettings()
    oracle: OracleSettings = OracleSettings()
    range_gate: RangeGateSettings = RangeGateSettings()
