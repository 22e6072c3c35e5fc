"""Settings of the back end: which closures are believed, how the graph is solved, how fine the map is."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from wiclosure.settings import Settings


class ClosureNoise(Settings):
    """What a registration's own covariance leaves out."""

    translation_m: float = Field(
        0.05,
        gt=0,
        description="m; added in quadrature to each axis of a closure's translation. A registration's covariance counts"
        " matched points as independent and is some ten times too small; what is left out is the scan's own distortion",
    )
    rotation_rad: float = Field(
        0.005,
        gt=0,
        description="rad; added in quadrature to each axis of a closure's rotation, for the same reason (0.3 degrees)",
    )


class PcmSettings(Settings):
    """Pairwise consistency maximisation (Mangelson et al. 2018)."""

    enabled: bool = Field(True, description="false: every verified closure goes to the graph unchecked")
    metric: Literal["mahalanobis", "unit"] = Field(
        "mahalanobis",
        description="mahalanobis: the cycle's error is weighed by the covariances of both closures and both odometry"
        " segments. unit: plain norm of the tangent vector, rad and m mixed, as in DiSCo-SLAM",
    )
    cycle: Literal["corrected", "legacy"] = Field(
        "corrected",
        description="legacy: DiSCo-SLAM's cycle, which takes a stored source-to-target transform for target-to-source"
        " and is not zero for perfect closures; only to reproduce its results",
    )
    probability: float = Field(
        0.99,
        gt=0,
        lt=1,
        description="share of pairs of true closures that pass: the chi-square quantile with 6 degrees of freedom",
    )
    weight: Literal["count", "structure"] = Field(
        "count",
        description="what makes a set large: the number of its closures, or the shares of structure that they match"
        " taken together, so that few good closures outweigh some poor ones",
    )
    unit_threshold: float = Field(
        5.0, gt=0, description="norm below which a cycle is consistent, metric unit only; DiSCo-SLAM has 20 to 100"
    )
    start_threshold: int = Field(
        1, ge=1, description="closures of a robot pair below which none is believed; DiSCo-SLAM has 5, or 2 if harsh"
    )
    min_clique_size: int = Field(
        2,
        ge=1,
        description="closures that must agree. One alone cannot be checked; a place that is truly shared is seen from"
        " several keyframes, and a lone closure is mostly a poor one",
    )
    guard: bool = Field(
        True,
        description="refuse a largest set that chance explains (see `chance`) or that has a rival as large; without it"
        " the first largest set is believed, as in DiSCo-SLAM",
    )
    chance: float = Field(
        0.001,
        gt=0,
        lt=1,
        description="chance that two unrelated false closures agree (0.0003 measured on street scenes, with a margin);"
        " the set must be larger than chance makes it among so many closures: 2 of up to 10, 3 of up to 400",
    )
    min_extent_m: float = Field(
        3.0,
        ge=0,
        description="m that a set must span on both robots' paths unless a prediction supports it: neighbouring"
        " keyframes of one look-alike place agree with each other whatever the place (guard only)",
    )
    rival_share: float = Field(
        0.8,
        gt=0,
        le=1,
        description="a set that contradicts the largest one and is at least this share of it makes the pair ambiguous:"
        " neither is believed (guard only)",
    )
    max_scale: float = Field(
        1.0,
        ge=1,
        le=128,
        description="how many times too small the stated standard deviations may be: they are doubled, up to so much,"
        " as long as that makes the consistent sets a tenth larger. 1: taken as stated. `wiclosure optimize` uses 10",
    )
    time_budget_s: float = Field(
        5.0, gt=0, description="s for each pair of robots; then the largest set found so far is used and reported so"
    )
    noise: ClosureNoise = ClosureNoise()

    @model_validator(mode="after")
    def _legacy_has_no_covariance(self) -> Self:
        if self.cycle == "legacy" and self.metric == "mahalanobis":
            raise ValueError("cycle: legacy has no covariance of its own; set metric: unit with it")
        return self


class PoseGraphSettings(Settings):
    """The estimate over the keyframes of all robots."""

    optimiser: Literal["joint", "two-stage"] = Field(
        "joint",
        description="joint: all keyframes of all robots in one graph. two-stage: one rigid transform for each pair of"
        " robots, then a graph of robots, as in DiSCo-SLAM; odometry drift stays in",
    )
    robust: Literal["gnc", "cauchy", "none"] = Field(
        "gnc",
        description="gnc: graduated non-convexity with truncated least squares, needs no good start and decides on each"
        " closure (Yang et al. 2020). cauchy: a fixed kernel. none: every closure counts in full",
    )
    probability: float = Field(
        0.99,
        gt=0,
        lt=1,
        description="share of true closures that the graph keeps: chi-square quantile, 6 degrees of freedom, on a"
        " closure's own residual",
    )
    radio: bool = Field(
        False,
        description="the ranges and bearings that the filter's alignments rest on count as measurements too, and join"
        " robots that no closure joins (joint only; g2o, and so `wiclosure optimize`, has none)",
    )
    anchor: str = Field("", description="robot whose odometry frame is the world; empty: the first of the data set")
    sigma_scale: float = Field(
        1.0,
        gt=0,
        description="factor on all stated standard deviations, of odometry and closures alike: it moves no pose, but"
        " the residual at which a closure is rejected, and the marginals",
    )
    noise: ClosureNoise = ClosureNoise()

    @model_validator(mode="after")
    def _radio_needs_keyframes(self) -> Self:
        if self.radio and self.optimiser != "joint":
            raise ValueError(
                "radio joins keyframes, which optimiser: two-stage has none of; set optimiser: joint with it"
            )
        return self

    def scaled(self, factor: float) -> Self:
        """With `sigma_scale` larger by a factor, as `PcmResult.scale` asks for."""
        return self.model_copy(update={"sigma_scale": factor * self.sigma_scale})


class MapSettings(Settings):
    """The merged map."""

    voxel_size_m: float = Field(0.2, gt=0, description="m; one point a voxel: fine enough for poles and kerbs")
    occupancy_cell_m: float = Field(
        0.25, gt=0, description="m a pixel of the occupancy image; wider where it would be huge"
    )
    obstacle_min_m: float = Field(0.3, gt=0, description="m above the ground around from which points are obstacles")
    obstacle_max_m: float = Field(2.0, gt=0, description="m above the ground from which robots drive below them")
