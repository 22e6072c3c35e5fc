"""Settings of the back end: which closures are accepted, how the graph is solved, how fine the map is."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator
from scipy.stats import chi2

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
    """Consistency of closures with each other and with odometry."""

    enabled: bool = Field(True, description="false: every verified closure goes to the graph unchecked")
    method: Literal["groups", "clique"] = Field(
        "groups",
        description="groups: robots are joined group by group by dense sets of closures that chance does not explain,"
        " and every closure is held against what all others predict. clique: pairwise consistency maximisation as"
        " published (Mangelson et al. 2018), the largest set of each pair of robots; metric: unit is always so",
    )
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
        description="share of pairs of true closures that agree (chi-square quantile, 6 degrees of freedom); and, with"
        " method: groups, that not one of all true closures is taken for an outlier",
    )
    unit_threshold: float = Field(
        5.0, gt=0, description="norm below which a cycle is consistent, metric unit only; DiSCo-SLAM has 20 to 100"
    )
    start_threshold: int = Field(
        1,
        ge=1,
        description="closures of a robot pair below which none is accepted, method clique only; DiSCo-SLAM has 5, or 2"
        " if harsh",
    )
    min_clique_size: int = Field(
        2,
        ge=1,
        description="closures that must agree. One alone cannot be checked; a place that is truly shared is seen from"
        " several keyframes, and a lone closure is mostly a poor one",
    )
    ambiguous_share: float = Field(
        0.8,
        gt=0,
        le=1,
        description="a set that contradicts the largest one and is at least this share of it makes the pair ambiguous:"
        " neither is accepted unless other robots settle it (groups only)",
    )
    view_keyframes: float = Field(
        10.0,
        ge=0,
        description="keyframes over which one view reaches: closures between two robots that lie within it, and span"
        " little of both paths, may be of one look-alike place and need support (groups only). Less, where places are"
        " known not to look alike: 0 doubts none that span more than they measure",
    )
    max_scale: float = Field(
        1.0,
        ge=1,
        le=128,
        description="how many times too small or too large the stated standard deviations may be: the factor is"
        " estimated within these bounds, too large by their third power (groups only). 1: taken as stated."
        " `wiclosure optimize` uses 10",
    )
    time_budget_s: float = Field(
        5.0,
        gt=0,
        description="s for each pair of robots, method clique only; then the largest set found so far is used and"
        " reported so",
    )
    noise: ClosureNoise = ClosureNoise()

    @property
    def published(self) -> bool:
        """Whether pairwise consistency maximisation as published decides."""
        return self.method == "clique" or self.metric == "unit"

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
        description="that not one of all true closures is taken for an outlier: chi-square quantile, 6 degrees of"
        " freedom, on a closure's own residual",
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

    def inlier_limit(self, closures: int, degrees: int = 6) -> float:
        """Squared distance, by stated covariances, up to which one of so many closures is an inlier."""
        share = self.probability ** (1.0 / max(closures, 1))
        return float(chi2.ppf(share, degrees)) * self.sigma_scale**2

    def scaled(self, factor: float) -> Self:
        """With `sigma_scale` larger by a factor, as `PcmResult.scale` asks for."""
        return self.model_copy(update={"sigma_scale": factor * self.sigma_scale})


class MapSettings(Settings):
    """The merged map."""

    voxel_size_m: float = Field(0.2, gt=0, description="m; one point per voxel: fine enough for poles and kerbs")
    moving_objects: bool = Field(
        True,
        description="false: points that scans a little earlier and later looked through are left out, as those of cars"
        " and people; takes about as long as odometry",
    )
    occupancy_cell_m: float = Field(
        0.25, gt=0, description="m a pixel of the occupancy image; wider where it would be huge"
    )
    obstacle_min_m: float = Field(0.3, gt=0, description="m above the ground around from which points are obstacles")
    obstacle_max_m: float = Field(2.0, gt=0, description="m above the ground from which robots drive below them")
