"""Settings of the front end: few numbers, the rest is derived from them or from the scans."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from wiclosure.settings import Settings


class OdometrySettings(Settings):
    """KISS-ICP or recorded odometry, and which points it sees."""

    source: Literal["recorded", "kiss-icp"] = Field(
        "recorded", description="recorded: a robot's own where the data set names one, else KISS-ICP; kiss-icp: always"
    )

    max_range_m: float = Field(100.0, gt=0, description="m; points beyond are noise or the sky (KISS-ICP's default)")
    min_range_m: float = Field(0.0, ge=0, description="m; raise it where the sensor sees its own carrier")
    voxel_size_m: float | None = Field(
        None, gt=0, description="m; none: from the extent of the first scan, 1 m on a street, 0.25 m in rooms"
    )
    elevation_correction_deg: float | None = Field(
        None,
        ge=-5,
        le=5,
        description="degrees that all beams look higher than the recording says; none: 0.205 for KITTI folders, as"
        " KISS-ICP adds where it reads KITTI by itself, and 0 for all else",
    )
    deskew: bool = Field(True, description="undo the motion during the sweep, where points carry their times")
    convergence: float = Field(
        1e-3,
        gt=0,
        description="m and rad: registration ends where a step is smaller; KISS-ICP's own 1e-4 takes 1.6 times as long,"
        " and 70 m of a recorded drive differ by at most 2 cm",
    )
    points_per_voxel: int = Field(
        10,
        ge=1,
        description="of the map that scans are registered to; KISS-ICP's own 20 takes a third longer and drifts as"
        " much, in streets and halls",
    )
    num_threads: int = Field(
        1, ge=0, description="one is bit-reproducible, also over any -j; 0: all cores, quicker where they are free"
    )

    @model_validator(mode="after")
    def _ranges_in_order(self) -> Self:
        if self.min_range_m >= self.max_range_m:
            raise ValueError(
                f"min_range_m {self.min_range_m} is not below max_range_m {self.max_range_m}: no point would be left"
            )
        return self


class KeyframeSettings(Settings):
    """Which scans are remembered, and how much of them."""

    distance_m: float = Field(1.0, gt=0, description="m moved since the last keyframe (as DiSCo-SLAM)")
    rotation_rad: float = Field(0.2, gt=0, description="rad turned since the last keyframe (as DiSCo-SLAM)")
    scans: int = Field(
        1,
        ge=1,
        description="the last so many scans make up a keyframe's cloud: a few where scans are sparse; many see around"
        " corners, and registration takes what lies there for free-space conflicts",
    )
    cloud_voxel_size_m: float | None = Field(
        None, gt=0, description="m; none: half the odometry's voxel, what the finest step of registration can use"
    )


class ScanContextSettings(Settings):
    """The place descriptor of Kim and Kim (IROS 2018); equal for all robots, otherwise they cannot be compared."""

    rings: int = Field(20, ge=2, description="distance bins (paper: 20)")
    sectors: int = Field(60, ge=4, description="direction bins (paper: 60, 6 degrees each)")
    max_range_m: float = Field(80.0, gt=0, description="m; farther points are left out (paper: 80; 20-40 indoors)")
    height_offset_m: float = Field(
        2.0, ge=0, description="m added to heights, about the sensor's height, so that what lies below it counts"
    )
    min_points_per_bin: int = Field(1, ge=1, description="a bin with fewer is empty (DiSCo-SLAM: 5)")


class MatchingSettings(Settings):
    """Which candidate pairs are proposed to the registration."""

    ring_key: Literal["mean-height", "occupied-share"] = Field(
        "mean-height", description="what of a ring is searched by (paper and DiSCo-SLAM: occupied-share)"
    )
    ring_key_neighbours: int | None = Field(
        50, ge=1, description="candidates per keyframe, with the most similar ring keys; none: every pair is compared"
    )
    candidates_per_keyframe: int = Field(1, ge=1, description="best of them that are proposed")
    lateral_shift_m: float | None = Field(
        None, gt=0, description="m; descriptors of the query moved so far to either side are tried too (augmented ones)"
    )
    suppression: int = Field(
        0,
        ge=0,
        description="keyframes along both paths within which only the best pair is proposed, where nothing tells where"
        " the pairs lie; 0: all are. There their number is what tells true from false",
    )
    suppression_where_located: int = Field(
        3,
        ge=0,
        description="the same where the filter, or a robot's own odometry, tells where they lie: a fifth of the"
        " closures then gives the same map in a fifth of the time. Less where fewer than 30 would be left",
    )
    budget: int | None = Field(
        None, ge=1, description="proposed closures of two robots; more are thinned out evenly along the paths"
    )
    max_distance: float = Field(
        0.4, gt=0, le=1, description="scan context distance; on a street 0.2 for scans 1 m apart, 0.4 for 5 m, else 0.5"
    )
    max_distance_with_prediction: float = Field(
        0.4,
        gt=0,
        le=1,
        description="the same where the filter predicts the pose; well below the 0.5 of unrelated scans: pairs beyond"
        " are mostly far apart, cost as much to register, and measure the pose less well",
    )


class RegistrationSettings(Settings):
    """How a proposed closure is measured, and when it is accepted."""

    method: Literal["gicp", "point-to-point"] = Field("gicp", description="point-to-point: as DiSCo-SLAM does it")
    voxel_size_m: float | None = Field(
        None, gt=0, description="m, finest of three (x 4, 2, 1); none: from the extent of the clouds, 0.5 on a street"
    )
    global_start: Literal["scan-context", "kiss-matcher"] = Field(
        "scan-context",
        description="where nothing is predicted: scan context's yaw and turns of it, and besides, with kiss-matcher,"
        " the pose that features of both clouds tell (an optional library: pip install 'wiclosure[kiss-matcher]';"
        " last digits differ from run to run)",
    )
    yaw_hypotheses: int = Field(
        8, ge=1, description="starting headings around the circle, from scan context's on, where nothing is predicted"
    )
    min_inlier_ratio: float = Field(
        0.4,
        ge=0,
        le=1,
        description="share of structure (ground left out) that must match; wrong poses reach 0.26 on streets",
    )
    min_inlier_ratio_with_prediction: float = Field(
        0.25,
        ge=0,
        le=1,
        description="the same where the result agrees with the filter's prediction; true pairs 16 m"
        " apart on a street have 0.34 or more",
    )
    min_agreement: float = Field(
        0.94,
        ge=0,
        le=1,
        description="matched points among those matched or in free-space conflict; true pairs 10 m apart have 0.95 or"
        " more on streets and 0.98 in rooms, wrong poses reach 0.93 between equal pillars",
    )
    min_agreement_with_prediction: float = Field(
        0.9, ge=0, le=1, description="the same where the result agrees with the filter's prediction"
    )
    ambiguity: float = Field(
        0.75, gt=0, le=1, description="refused where another pose reaches this share of the best one's score"
    )
    prediction_scale: float = Field(
        2.0,
        ge=1,
        description="predictions' standard deviations count so many times: walls err for all measurements alike, which"
        " their covariance does not know",
    )
    min_inliers: int = Field(100, ge=6, description="matched points of structure; with fewer, a share says little")
    prior_probability: float = Field(
        0.999, gt=0, lt=1, description="a measurement outside this chi-square interval of the prediction contradicts it"
    )
    max_fitness_m2: float = Field(
        5.0, gt=0, description="m^2, mean squared distance that point-to-point accepts (DiSCo-SLAM: 3 park, 5 KITTI)"
    )
    num_threads: int = Field(
        1, ge=1, description="of one registration; more than one waste time wherever something else wants the cores"
    )
    cached_clouds: int = Field(64, ge=2, description="prepared keyframes kept at hand, some 5 MB each")


class IntraRobotLoopSettings(Settings):
    """Loop closures within one robot's own trajectory."""

    enabled: bool = Field(True, description="whether they are looked for")
    keyframes_per_loop: float = Field(
        10.0,
        gt=0,
        description="keyframes of a robot for each loop that is registered at most: so the time that they take is a"
        " fixed share of that of odometry; more are thinned out evenly along the path",
    )
    min_travel_m: float = Field(30.0, gt=0, description="m travelled between two visits; less is no loop worth closing")
    radius_m: float = Field(10.0, gt=0, description="m within which two visits can be registered")
    gate_probability: float = Field(
        0.99,
        gt=0,
        lt=1,
        description="pairs that are farther apart by odometry, by this quantile of its drift, are none",
    )
