"""What is assumed where a pose graph's file does not say, or says what cannot be."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wiclosure.settings import Settings


class GraphFileSettings(Settings):
    """How `wiclosure optimize` reads the matrices of pose graphs."""

    sigma_m: float = Field(
        1.0, gt=0, le=1e4, description="m; standard deviation of the translation of edges that state no information"
    )
    sigma_rad: float = Field(
        1.0, gt=0, le=1e4, description="rad; standard deviation of the rotation of edges that state no information"
    )
    indefinite: Literal["refuse", "repair"] = Field(
        "refuse",
        description="information matrices with negative eigenvalues. refuse: such loops are left out, and the graph is"
        " refused where more than a fifth of its matrices, or one of its odometry, is so. repair: negative eigenvalues"
        " count as none, so that nothing is known along their axes",
    )
