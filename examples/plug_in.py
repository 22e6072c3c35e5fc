"""Wi-Closure in front of your own pipeline: plain arrays in, pairs of keyframe indices out.

python examples/plug_in.py
"""

import numpy as np

from wiclosure import AoaPath, Trajectory, WirelessLog, WirelessMeasurement, make_filter, se3

# --- What your pipeline has: for each robot stamps and odometry poses, and what its radio measured. -------------------
rng = np.random.default_rng(0)
stamps_ns = np.arange(200) * 500_000_000  # 100 s, two keyframes a second
along = 2.0 * np.arange(200)
north = np.stack([along, 20.0 * np.sin(along / 40.0), 0.0 * along], axis=1)  # alpha drives along a winding road
south = np.stack([500.0 - along, 20.0 * np.sin((500.0 - along) / 40.0), 0.0 * along], axis=1)  # beta comes towards it


def as_poses(positions: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) that look along the path."""
    ahead = np.gradient(positions, axis=0)
    return se3.from_yaw(np.arctan2(ahead[:, 1], ahead[:, 0]), positions)


world = {"alpha": as_poses(north), "beta": as_poses(south)}
odometry = {name: se3.inverse(poses[0]) @ poses for name, poses in world.items()}  # each in a frame of its own

heard = []  # (index, range in m, bearings in rad), once a second within 150 m; most bearings are reflections
for i in range(0, 200, 2):
    x, y, _ = se3.between(world["alpha"][i], world["beta"][i])[:3, 3]
    if np.hypot(x, y) < 150.0:
        heard.append((i, np.hypot(x, y) + rng.normal(0, 0.5), [np.arctan2(y, x), *rng.uniform(-3, 3, 2)]))

# --- What you add. ----------------------------------------------------------------------------------------------------
trajectories = {name: Trajectory(name, stamps_ns, poses) for name, poses in odometry.items()}
measurements = tuple(
    WirelessMeasurement(
        stamp_ns=stamps_ns[i],
        receiver="alpha",
        transmitter="beta",
        range_m=distance,
        range_sigma_m=0.5,
        paths=tuple(AoaPath(azimuth=bearing, sigma=0.17) for bearing in bearings),
    )
    for i, distance, bearings in heard
)
wireless = WirelessLog(measurements)
result = make_filter("wiclosure").candidates(trajectories, wireless)

# --- What you get: pairs to compare, each with its chance of overlap and a first guess for the registration. ----------
for pairs in result.pairs:
    print(f"{pairs.robot_a} and {pairs.robot_b}: compare {len(pairs)} of {result.pairs_total} pairs")
    best = np.argsort(-pairs.overlap_probability)[:3]
    predicted = pairs.predicted(best)
    if predicted is None:  # the radio cannot tell how these two lie: every pair is kept, and the diagnosis says why
        continue
    T_a_b, covariance = predicted
    for row, T, C in zip(best, T_a_b, covariance, strict=True):
        print(
            f"  keyframes {pairs.index_a[row]} and {pairs.index_b[row]}:"
            f" overlap {pairs.overlap_probability[row]:.2f}, predicted x {T[0, 3]:.1f} m, y {T[1, 3]:.1f} m,"
            f" yaw {np.degrees(se3.yaw(T)):.0f} degrees, sigma {np.sqrt(np.trace(C[3:5, 3:5]) / 2):.1f} m"
        )
for sentence in result.diagnosis:
    print(sentence)

# --- And after the registration: does the measured pose contradict the prediction?  Here of the last pair above. ------
measured = np.diag(np.square([0.01, 0.01, 0.01, 0.1, 0.1, 0.1]))  # rad, m: how exact your registration is
for wrong_m in (0.0, 20.0):
    T_measured = T @ se3.from_yaw(0.0, np.array([wrong_m, 0.0, 0.0]))
    error = se3.log(se3.between(T, T_measured))
    # Sigmas of the prediction count twice: walls make measurements err alike.  22.5 is 0.999 of chi-square, 6 unknowns.
    chi2 = float(error @ np.linalg.solve(4 * C + measured, error))
    print(f"moved by {wrong_m:g} m: {'contradicts the prediction' if chi2 > 22.5 else 'agrees'}, chi-square {chi2:.0f}")
# Where the radio predicts no pose for certain, `result.checks` knows what it has against measured ones all the same.
