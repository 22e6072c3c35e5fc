"""Arrays as columns of a recording: one row for each stamp, with one thing or several in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from wiclosure.types import Float32Array, FloatArray, IntArray

TIME = "time"
"""The one timeline: the recordings' own stamps."""


def time_column(stamps_ns: IntArray) -> rr.TimeColumn:
    """The stamps of the rows."""
    return rr.TimeColumn(TIME, timestamp=np.asarray(stamps_ns, np.int64).astype("datetime64[ns]"))


def by_stamp(stamps_ns: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """The order that sorts by stamp, the stamps without repeats, and how many rows each has."""
    order = np.argsort(stamps_ns, kind="stable")
    unique, counts = np.unique(stamps_ns, return_counts=True)
    return order, unique, counts


def poses(recording: rr.RecordingStream, path: str, stamps_ns: IntArray, T_parent_child: FloatArray) -> None:
    """A frame that moves: `(N, 4, 4)` over time."""
    columns = rr.Transform3D.columns(translation=T_parent_child[:, :3, 3], quaternion=_quat_xyzw(T_parent_child))
    recording.send_columns(path, [time_column(stamps_ns)], columns)


def points(
    recording: rr.RecordingStream, path: str, stamps_ns: IntArray, clouds: Sequence[Float32Array | FloatArray]
) -> None:
    """A cloud for each stamp."""
    if len(clouds):
        columns = rr.Points3D.columns(positions=np.concatenate(clouds).astype(np.float32))
        recording.send_columns(path, [time_column(stamps_ns)], columns.partition([len(cloud) for cloud in clouds]))


def lines(
    recording: rr.RecordingStream,
    path: str,
    stamps_ns: IntArray,
    ends: FloatArray,
    labels: Sequence[str] | None = None,
) -> None:
    """Lines `(N, 2, 3)`, each from its stamp `(N,)` on, with what hovering over it says."""
    if not len(ends):
        return
    order, unique, counts = by_stamp(stamps_ns)
    said = None if labels is None else [labels[row] for row in order]
    columns = rr.LineStrips3D.columns(strips=list(ends[order].astype(np.float32)), labels=said)
    recording.send_columns(path, [time_column(unique)], columns.partition(counts))


def ellipsoids(
    recording: rr.RecordingStream, path: str, stamps_ns: IntArray, T_world_body: FloatArray, covariance: FloatArray
) -> None:
    """One standard deviation of positions `(N, 4, 4)` around each, from covariances `(N, 6, 6)` in the body's axes."""
    if not len(T_world_body):
        return
    order, unique, counts = by_stamp(stamps_ns)
    variances, axes = np.linalg.eigh(covariance[order, 3:, 3:])
    axes[np.linalg.det(axes) < 0, :, 0] *= -1.0  # a rotation, not a reflection
    turned = T_world_body[order].copy()
    turned[:, :3, :3] = turned[:, :3, :3] @ axes
    columns = rr.Ellipsoids3D.columns(
        centers=turned[:, :3, 3],
        half_sizes=np.sqrt(np.maximum(variances, 0.0)),
        quaternions=_quat_xyzw(turned),
    )
    recording.send_columns(path, [time_column(unique)], columns.partition(counts))


def scalars(recording: rr.RecordingStream, path: str, stamps_ns: IntArray, values: FloatArray) -> None:
    """A curve `(N,)`; what is not known of it is left out."""
    known = np.isfinite(values)
    if known.any():
        recording.send_columns(path, [time_column(stamps_ns[known])], rr.Scalars.columns(scalars=values[known]))


def _quat_xyzw(T_parent_child: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_matrix(T_parent_child[:, :3, :3]).as_quat())
