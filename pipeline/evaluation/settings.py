"""What counts as true in an evaluation."""

from __future__ import annotations

from pydantic import Field

from wiclosure.settings import Settings


class EvaluationSettings(Settings):
    """What counts as true."""

    overlap_radius_m: float = Field(
        35.0, gt=0, description="m; keyframes nearer than this see a common place (the paper's radius): `candidates`"
    )
    registrable_radius_m: float = Field(
        10.0, gt=0, description="m; keyframes nearer than this can be registered reliably: `candidates_registrable`"
    )
    closure_error_m: float = Field(
        2.0,
        gt=0,
        description="m; an accepted closure further off ground truth is false. Ground truth itself is good to a metre"
        " or so (GNSS, or two passes through one place), false closures are off by tens",
    )
    closure_error_deg: float = Field(
        5.0, gt=0, description="degrees; an accepted closure turned further from ground truth is false"
    )
    ground_truth_gap_s: float = Field(
        1.0, gt=0, description="s; a pose is compared only if ground truth has stamps this near on both sides"
    )
    rpe_distance_m: float = Field(10.0, gt=0, description="m; path length over which relative pose errors are taken")
