"""LAS and LAZ files; needs laspy (the extra `las`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.clouds.columns import CloudColumns, ColumnNames, returns


def read_las(path: Path) -> CloudColumns:
    """Points, GPS times and intensity of a LAS or LAZ file.

    Raises:
        InputError: laspy is missing, or cannot read the file.
    """
    try:
        import laspy
    except ImportError as error:
        raise InputError(f"{path}: LAS files need laspy; install it (pip install 'wiclosure[las]')") from error
    try:
        cloud = laspy.read(path)
        columns = {"x": np.asarray(cloud.x), "y": np.asarray(cloud.y), "z": np.asarray(cloud.z)}
        names = set(cloud.point_format.dimension_names)
        columns |= {name: np.asarray(cloud[name]) for name in ("gps_time", "intensity") if name in names}
    except Exception as error:  # laspy and lazrs raise kinds of their own
        raise InputError(f"{path} cannot be read as LAS ({error}); copy it again or remove it") from error
    time, intensity = (name if name in columns else None for name in ("gps_time", "intensity"))
    return returns(columns, ColumnNames("x", "y", "z", time, intensity))
