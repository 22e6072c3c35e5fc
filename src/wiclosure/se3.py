"""Arithmetic on rigid transforms, vectorised over leading dimensions.

`T_a_b` maps points of frame b into frame a.  Tangent vectors are `[rotation, translation]` (GTSAM's order) and perturb
on the right: `T_true = T @ exp(xi)`.  Shapes: transforms `(..., 4, 4)`, tangent vectors `(..., 6)`, covariances
`(..., 6, 6)`.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from wiclosure.arrays import FloatArray, IntArray


def inverse(T_a_b: FloatArray) -> FloatArray:
    """`T_b_a` of each transform."""
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    T_b_a = np.zeros_like(T_a_b)
    T_b_a[..., :3, :3] = R_b_a
    T_b_a[..., :3, 3] = -np.einsum("...ij,...j->...i", R_b_a, T_a_b[..., :3, 3])
    T_b_a[..., 3, 3] = 1.0
    return T_b_a


def between(T_w_a: FloatArray, T_w_b: FloatArray) -> FloatArray:
    """`T_a_b` of two poses in one frame w."""
    return inverse(T_w_a) @ T_w_b


def transform(T_a_b: FloatArray, points_b: FloatArray) -> FloatArray:
    """Points `(N, 3)` of frame b in frame a; `T_a_b` is `(4, 4)`, or `(N, 4, 4)` for one transform a point."""
    return np.asarray(np.einsum("...ij,...j->...i", T_a_b[..., :3, :3], points_b) + T_a_b[..., :3, 3])


def exp(xi: FloatArray) -> FloatArray:
    """The transform of a tangent vector `[rotation, translation]`."""
    flat = np.asarray(xi, float).reshape(-1, 6)
    if len(flat) == 0:
        return np.zeros((*np.shape(xi)[:-1], 4, 4))
    return np.asarray(RigidTransform.from_exp_coords(flat).as_matrix()).reshape(*np.shape(xi)[:-1], 4, 4)


def log(T: FloatArray) -> FloatArray:
    """The tangent vector `[rotation, translation]` of a transform; inverse of `exp` for rotations below pi.

    In closed form: ten times as fast as scipy, which checks every rotation.
    """
    flat = np.asarray(T, float).reshape(-1, 4, 4)
    t, (axis, twice_sine, twice_cosine) = flat[:, :3, 3], _axis(flat)
    angle = np.arctan2(twice_sine, twice_cosine)
    small = angle < 1e-4
    w = axis * np.where(small, 0.5, angle / np.where(twice_sine == 0, 1.0, twice_sine))[:, None]
    half = np.where(small, 1.0, 0.5 * angle)
    curl = np.where(small, 1.0 / 12.0, (1.0 - half / np.tan(half)) / np.where(small, 1.0, angle) ** 2)
    w_t = _cross(w, t)
    xi = np.concatenate([w, t - 0.5 * w_t + curl[:, None] * _cross(w, w_t)], axis=1)
    if len(turned := np.flatnonzero(twice_cosine < -1.9)):  # near pi R - R^T says little
        xi[turned] = RigidTransform.from_matrix(flat[turned]).as_exp_coords()
    return xi.reshape(*np.shape(T)[:-2], 6)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Of stacks `(N, 3)`; NumPy's takes longer, most of all of a few."""
    (x, y, z), (u, v, w) = a.T, b.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)


def skew(v: FloatArray) -> FloatArray:
    """`(..., 3, 3)` matrices with `skew(v) @ w == cross(v, w)`."""
    S = np.zeros((*v.shape, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    S[..., 1, 0], S[..., 2, 0], S[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return S


def adjoint(T_a_b: FloatArray) -> FloatArray:
    """`(..., 6, 6)` with `exp(Ad xi_b) = T exp(xi_b) T^-1`: moves tangent vectors from frame b to frame a."""
    R, t = T_a_b[..., :3, :3], T_a_b[..., :3, 3]
    Ad = np.zeros((*T_a_b.shape[:-2], 6, 6))
    Ad[..., :3, :3] = R
    Ad[..., 3:, :3] = skew(t) @ R
    Ad[..., 3:, 3:] = R
    return Ad


def rotate_covariance(A: FloatArray, covariance: FloatArray) -> FloatArray:
    """`A @ covariance @ A.T`, for stacks."""
    return np.asarray(A @ covariance @ np.swapaxes(A, -1, -2))


def compose_covariance(covariance_ab: FloatArray, T_b_c: FloatArray, covariance_bc: FloatArray) -> FloatArray:
    """Covariance of `T_a_c = T_a_b @ T_b_c` for independent errors, to first order."""
    return rotate_covariance(adjoint(inverse(T_b_c)), covariance_ab) + covariance_bc


def inverse_covariance(T_a_b: FloatArray, covariance_ab: FloatArray) -> FloatArray:
    """Covariance of `T_b_a` from that of `T_a_b`, to first order."""
    return rotate_covariance(adjoint(T_a_b), covariance_ab)


def from_rotation_translation(R: FloatArray, t: FloatArray) -> FloatArray:
    """Transforms `(..., 4, 4)` from rotations `(..., 3, 3)` and translations `(..., 3)`."""
    T = np.zeros((*t.shape[:-1], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def from_yaw(yaw_rad: FloatArray | float, translation: FloatArray) -> FloatArray:
    """Transforms `(..., 4, 4)` that turn about z by `yaw_rad (...)` and move by `translation (..., 3)`."""
    yaw = np.asarray(yaw_rad, float)
    T = np.zeros((*np.broadcast_shapes(yaw.shape, np.shape(translation)[:-1]), 4, 4))
    T[..., 0, 0] = T[..., 1, 1] = np.cos(yaw)
    T[..., 1, 0] = np.sin(yaw)
    T[..., 0, 1] = -T[..., 1, 0]
    T[..., 2, 2] = T[..., 3, 3] = 1.0
    T[..., :3, 3] = translation
    return T


def yaw(T: FloatArray) -> FloatArray:
    """Angle about z of each transform, radians in (-pi, pi]."""
    return np.asarray(np.arctan2(T[..., 1, 0], T[..., 0, 0]))


def wrap_angle(angle_rad: FloatArray) -> FloatArray:
    """The same angles within [-pi, pi)."""
    return np.asarray((angle_rad + np.pi) % (2 * np.pi) - np.pi)


def rotation_angle(T: FloatArray) -> FloatArray:
    """Angle of each rotation, radians in [0, pi]; exact for small angles too."""
    _, twice_sine, twice_cosine = _axis(T)
    return np.asarray(np.arctan2(twice_sine, twice_cosine))


def _axis(T: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of each rotation, the axis `(..., 3)` as long as twice the sine of the angle, this, and twice the cosine."""
    R = T[..., :3, :3]
    axis = np.stack([R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]], axis=-1)
    return axis, np.linalg.norm(axis, axis=-1), np.trace(R, axis1=-2, axis2=-1) - 1.0


def interpolate(stamps_ns: IntArray, poses: FloatArray, at_ns: IntArray) -> FloatArray:
    """Poses `(M, 4, 4)` at the stamps `at_ns (M,)`: linear in position, spherical in rotation.

    Stamps outside the range take the first or the last pose: the caller decides whether that is allowed.
    """
    if len(stamps_ns) == 1:
        return np.broadcast_to(poses[0], (len(at_ns), 4, 4)).copy()
    # Integer differences first: nanoseconds since 1970 do not fit a float64.
    seconds = (stamps_ns - stamps_ns[0]) * 1e-9
    at = np.clip((np.asarray(at_ns, np.int64) - stamps_ns[0]) * 1e-9, 0.0, seconds[-1])
    upper = np.clip(np.searchsorted(seconds, at, side="right"), 1, len(seconds) - 1)
    lower = upper - 1
    fraction = ((at - seconds[lower]) / (seconds[upper] - seconds[lower]))[:, None]
    translation = (1 - fraction) * poses[lower, :3, 3] + fraction * poses[upper, :3, 3]
    if len(at) == 0:
        return np.zeros((0, 4, 4))
    start = Rotation.from_matrix(poses[lower, :3, :3])  # only the poses in question: trajectories may be long
    turn = start.inv() * Rotation.from_matrix(poses[upper, :3, :3])
    rotation = (start * Rotation.from_rotvec(fraction * turn.as_rotvec())).as_matrix()
    return from_rotation_translation(rotation, translation)
