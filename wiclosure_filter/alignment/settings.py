"""Settings of frame alignment: what is believed of the radio, how hard to search, when to say "I cannot tell"."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wiclosure.settings import Settings


class RadioSettings(Settings):
    """What is believed of ranges and bearings beyond the sigma that each measurement brings."""

    direct_path_absent: float = Field(
        0.15, ge=0.0, lt=1.0, description="probability that no reported path is the direct one; 0.15 in WSR data sets"
    )
    range_outlier: float = Field(0.05, ge=0.0, lt=1.0, description="probability of a gross range error")
    range_biased: float = Field(
        0.15, ge=0.0, lt=1.0, description="probability of a range through an obstacle, longer than the distance"
    )
    range_bias_m: float = Field(1.0, ge=0.0, description="m, mean and spread of that excess")
    range_reach_m: float = Field(200.0, gt=0.0, description="m, gross range errors spread this far")
    static_radius_m: float = Field(
        1.0,
        ge=0.0,
        description="m; measurements between antennas that moved less see one multipath situation, not many",
    )
    max_paths: int = Field(16, ge=1, description="strongest paths of a measurement that are considered")
    range_partner_s: float = Field(
        1.0, ge=0.0, description="s; a bearing without range borrows one measured within this time for its proposals"
    )


class GuardSettings(Settings):
    """When an alignment must not be used to prune."""

    min_odds: float = Field(
        20.0, gt=1.0, description="odds against all different alignments below which the best is not certain"
    )
    min_redundancy: float = Field(
        1.5,
        ge=0.0,
        description="measured numbers beyond those that the alignment needs; a chance agreement has few to spare",
    )
    max_yaw_sigma_rad: float = Field(0.35, gt=0.0, description="rad; beyond it errors are no longer Gaussian")
    max_relative_sigma: float = Field(
        0.25, gt=0.0, description="position sigma at the links over the distance of the links; beyond it likewise"
    )
    same_place_fraction: float = Field(
        0.15,
        gt=0.0,
        description="alignments that differ by less (over the links' distance) are one: the covariance covers it",
    )


class AlignmentSettings(Settings):
    """How two odometry frames are aligned from what the robots heard of each other."""

    radio: RadioSettings = RadioSettings()
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
        0.1,
        gt=0.0,
        description="the same prior over the distance, as roads are not steep; not where the radio tells heights",
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
    guard: GuardSettings = GuardSettings()
