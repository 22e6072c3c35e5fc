"""Pairwise consistency of links: how the paper rejects multipath (section IV-A).

Every path with a range and a known relative heading is a full transform between the robots.  Two of them are consistent
if the loop through both and the odometry of both robots closes,

    T_loop = T^i_j T^j_l (T^k_l)^-1 T^k_i,   xi = log T_loop,   xi^T Sigma_loop^-1 xi < chi-square,

(the paper's T^i_j T^j_k T^k_l T^l_i with the indices that close it); the largest set of mutually consistent paths, at
most one a measurement, are taken for the direct ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.max_clique import max_clique
from wiclosure.types import BoolArray, FloatArray, IntArray
from wiclosure.wiclosure_filter.consensus.consensus import AnchoredPeaks
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem, PairOdometry
from wiclosure.wiclosure_filter.consensus.refinement import Peaks, climb
from wiclosure.wiclosure_filter.likelihood.mixture import Mixture
from wiclosure.wiclosure_filter.likelihood.observations import LEVEL_SIGMA_RAD, Observations

_CLIQUES = 2  # the best, and the best of what it leaves
_TIME_BUDGET_S = 1.0
_PAIRS_AT_A_TIME = 20_000
_ODOMETRY_YAW_RAD = 0.1


@dataclass(frozen=True, eq=False)
class FullLinks:
    """L paths as transforms between the robots.

    Args:
        row, column: `(L,)` measurement and path.
        state: `(L, 4)` the frame transform that the path asks for, see `Observations`.
        covariance: `(L, 6, 6)` of the transform between the bodies, as errors in b's body axes.
    """

    row: IntArray
    column: IntArray
    state: FloatArray
    covariance: FloatArray

    def __len__(self) -> int:
        return len(self.row)

    def subset(self, rows: IntArray) -> FullLinks:
        """The links at `rows`."""
        return FullLinks(self.row[rows], self.column[rows], self.state[rows], self.covariance[rows])


def pairwise_consistency(
    problem: AlignmentProblem, confidence: float, *, max_links: int, height_ratio: float
) -> AnchoredPeaks | None:
    """The alignment of the largest consistent set of paths, and that of the next; None without known headings.

    Args:
        problem: measurements, odometry and priors of two robots.
        confidence: quantile of chi-square below which two links are consistent.
        max_links: links in the consistency graph.
        height_ratio: standard deviation of the robots' difference in height over their distance.
    """
    observations, prior = problem.observations, problem.prior
    links = full_links(problem, max_links, height_ratio)
    if len(links) == 0:
        return None
    states, chosen, anchors = [], [], []
    for clique in _cliques(consistency(links, observations, problem.odometry, confidence)):
        kept = np.full(len(observations), -1)
        kept[links.row[clique]] = links.column[clique]
        anchors.append(int(np.sort(links.row[clique])[len(clique) // 2]))
        drift = problem.odometry.drift_from(anchors[-1], observations)
        only = Mixture.of(_only(observations, kept), problem.radio, drift)
        states.append(climb(links.state[clique[:1]], only, prior).states[0])
        chosen.append(kept)
    mixture, drift = problem.anchored_at(anchors[0])
    peaks = Peaks.at(np.array(states), mixture, prior)
    return AnchoredPeaks(peaks, mixture, prior, drift, tuple(chosen))


def full_links(problem: AlignmentProblem, max_links: int, height_ratio: float) -> FullLinks:
    """Every path, or pair of reciprocal paths, that fixes the transform between the robots; the heaviest ones.

    Arguments as of `pairwise_consistency`.
    """
    observations = problem.observations
    row, column, yaw, yaw_sigma = _with_known_yaw(problem)
    strongest = np.sort(np.argsort(-observations.weight[row, column], kind="stable")[:max_links])
    row, column, yaw, yaw_sigma = row[strongest], column[strongest], yaw[strongest], yaw_sigma[strongest]
    reach = observations.near_range_m[row, None] * observations.direction[row, column]
    turn = se3.from_yaw(yaw, np.zeros((len(yaw), 3)))
    receives = observations.a_receives[row]
    w = np.where(receives[:, None], reach, -se3.transform(turn, reach))
    translation = observations.a[row] + w - se3.transform(turn, observations.b[row])
    states = np.column_stack([yaw, translation])
    sideways = observations.sigma[row, column] ** 2 + np.where(receives, 0.0, yaw_sigma**2)
    level = (height_ratio * observations.typical_distance_m) ** 2
    vertical = np.where(observations.flat[row, column], level, np.nan)
    in_a = _position_covariance(w, observations.near_range_sigma_m[row] ** 2, sideways, vertical)
    R_a_b = turn[:, :3, :3] @ problem.odometry.b.poses[observations.index_b[row], :3, :3]
    covariance = np.zeros((len(row), 6, 6))
    covariance[:, :3, :3] = np.diag([LEVEL_SIGMA_RAD**2, LEVEL_SIGMA_RAD**2, 0.0])
    covariance[:, 2, 2] = yaw_sigma**2
    covariance[:, 3:, 3:] = se3.rotate_covariance(np.swapaxes(R_a_b, 1, 2), in_a)
    return FullLinks(row, column, states, covariance)


def _with_known_yaw(problem: AlignmentProblem) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Row and column of paths with a range and a relative yaw, the yaw, and its sigma."""
    observations = problem.observations
    ranged = np.isfinite(observations.near_range_m)
    row, column = np.nonzero((observations.weight > 0) & ranged[:, None])
    if problem.heading_knowledge == "heading":
        known = np.isfinite(observations.yaw[row])
        row, column = row[known], column[known]
        return row, column, observations.yaw[row], observations.yaw_sigma[row]
    if problem.heading_knowledge == "reciprocal":
        return _reciprocal(observations, row, column, problem.partner)
    return row[:0], column[:0], np.zeros(0), np.zeros(0)


def consistency(links: FullLinks, observations: Observations, odometry: PairOdometry, confidence: float) -> BoolArray:
    """`(L, L)` true where two links, through the odometry between them, close a loop."""
    first, second = np.triu_indices(len(links), 1)
    turned = se3.wrap_angle(links.state[first, 0] - links.state[second, 0])
    yaw_variance = links.covariance[first, 2, 2] + links.covariance[second, 2, 2] + _ODOMETRY_YAW_RAD**2
    possible = (links.row[first] != links.row[second]) & (turned**2 < 16 * yaw_variance)  # spares most of the loops
    first, second = first[possible], second[possible]
    limit = chi2.ppf(confidence, 3 if observations.all_flat else 4)
    consistent = np.zeros((len(links), len(links)), bool)
    for start in range(0, len(first), _PAIRS_AT_A_TIME):
        one, other = first[start : start + _PAIRS_AT_A_TIME], second[start : start + _PAIRS_AT_A_TIME]
        closes = _loop_distance(links, one, other, observations, odometry) < limit
        consistent[one[closes], other[closes]] = True
    return consistent | consistent.T


def _loop_distance(
    links: FullLinks,
    one: IntArray,
    other: IntArray,
    observations: Observations,
    odometry: PairOdometry,
) -> FloatArray:
    """Squared Mahalanobis distances of the loops through two links each (paper, eqs. for T_loop and d_PCM)."""
    a, b = odometry.a, odometry.b
    i, k = observations.index_a[links.row[one]], observations.index_a[links.row[other]]
    j, m = observations.index_b[links.row[one]], observations.index_b[links.row[other]]
    X_one, X_other = (observations.frame_transform(links.state[side]) for side in (one, other))
    T_i_j = se3.between(a.poses[i], X_one @ b.poses[j])
    T_k_m = se3.between(a.poses[k], X_other @ b.poses[m])
    T_j_m, T_m_k, T_k_i = b.relative_pose(j, m), se3.inverse(T_k_m), a.relative_pose(k, i)
    covariance = se3.compose_covariance(links.covariance[one], T_j_m, odometry.covariance_b(j, m))
    covariance = se3.compose_covariance(covariance, T_m_k, se3.inverse_covariance(T_k_m, links.covariance[other]))
    covariance = se3.compose_covariance(covariance, T_k_i, odometry.covariance_a(k, i))
    xi = se3.log(T_i_j @ T_j_m @ T_m_k @ T_k_i)
    whitened = np.linalg.solve(covariance, xi[..., None])[..., 0]
    return np.asarray((xi * whitened).sum(axis=-1))


def _reciprocal(
    observations: Observations, row: IntArray, column: IntArray, partner: IntArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Paths of a's bearings, each with every path of the bearing back: yaw = azimuth_ab + pi - azimuth_ba."""
    forward = observations.a_receives[row] & (partner[row] >= 0)
    paths = observations.weight.shape[1]
    row, column = np.repeat(row[forward], paths), np.repeat(column[forward], paths)
    back, back_column = partner[row], np.tile(np.arange(paths), int(forward.sum()))
    real = observations.weight[back, back_column] > 0
    row, column, back, back_column = row[real], column[real], back[real], back_column[real]
    azimuth = np.arctan2(observations.direction[..., 1], observations.direction[..., 0])
    yaw = azimuth[row, column] + np.pi - azimuth[back, back_column]
    return row, column, yaw, np.hypot(observations.sigma[row, column], observations.sigma[back, back_column])


def _position_covariance(w: FloatArray, along: FloatArray, sideways: FloatArray, vertical: FloatArray) -> FloatArray:
    """`(L, 3, 3)` of a point at displacement w: variances along (m^2), across (rad^2), and of the height (m^2)."""
    distance = np.maximum(np.linalg.norm(w, axis=1), 1e-3)
    radial = w / distance[:, None]
    outer = radial[:, :, None] * radial[:, None, :]
    covariance = along[:, None, None] * outer + (sideways * distance**2)[:, None, None] * (np.eye(3) - outer)
    unknown = np.isfinite(vertical)
    covariance[unknown, 2, :2] = covariance[unknown, :2, 2] = 0.0
    covariance[unknown, 2, 2] = vertical[unknown]
    return np.asarray(covariance + 1e-6 * np.eye(3))


def _cliques(consistent: BoolArray) -> list[IntArray]:
    """The largest clique, then the largest without its members."""
    left = np.arange(len(consistent))
    cliques: list[IntArray] = []
    while len(left) and len(cliques) < _CLIQUES:
        members = max_clique(consistent[np.ix_(left, left)], time_budget_s=_TIME_BUDGET_S).members
        cliques.append(left[np.array(members, np.int64)])
        left = np.setdiff1d(left, cliques[-1])
    return cliques


def _only(observations: Observations, kept: IntArray) -> Observations:
    """The observations with the kept paths alone; measurements without one keep neither bearing nor range."""
    weight = np.zeros_like(observations.weight)
    rows = np.flatnonzero(kept >= 0)
    weight[rows, kept[rows]] = 1.0
    return observations.restricted(weight, np.where(kept >= 0, observations.range_m, np.nan))
