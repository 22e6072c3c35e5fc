"""Fits the noise model of WiFi bearings to WSR-Toolbox results with ground truth.

    python -m wiclosure.wiclosure_filter.links.noise_model FILES...

The model is the one that alignment uses: the azimuths of a profile's peaks come from the direct path, which is the peak
of rank k with weight `ratio^k`, or from nowhere in particular.  Sigma and the probability that the direct path is
absent follow the profile's variance.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from wiclosure import se3
from wiclosure.errors import InputError, WiclosureError
from wiclosure.formats.radio.wsr import AoaNoise, WsrProfile, read_wsr_profiles
from wiclosure.types import FloatArray

_MIN_PROFILES = 20
_VARIANCES = (0.55, 0.65, 0.75, 0.85, 1.0)


@dataclass(frozen=True, eq=False)
class NoiseFit:
    """A fitted noise model and what it rests on.

    Args:
        noise: the model.
        profiles: how many profiles were used.
        direct_absent: share of all profiles without a direct path, by the model.
        strongest_median_rad: median error of the strongest peak.
        strongest_gross: share of profiles whose strongest peak is over 30 degrees off.
    """

    noise: AoaNoise
    profiles: int
    direct_absent: float
    strongest_median_rad: float
    strongest_gross: float


def fit_noise_model(profiles: Sequence[WsrProfile]) -> NoiseFit:
    """Maximum likelihood over the profiles that have ground truth and peaks.

    Raises:
        InputError: too few such profiles.
    """
    used = [p for p in profiles if np.isfinite(p.true_azimuth) and len(p.azimuth)]
    if len(used) < _MIN_PROFILES:
        raise InputError(f"{len(used)} profiles with peaks and ground truth; a fit needs at least {_MIN_PROFILES}")
    error = np.full((len(used), max(len(p.azimuth) for p in used)), np.nan)
    for row, p in enumerate(used):
        error[row, : len(p.azimuth)] = se3.wrap_angle(p.azimuth - p.true_azimuth)
    variance = np.array([p.variance for p in used])
    start = np.array([np.log(0.12), 0.0, -2.0, 0.0, -1.0])
    best = minimize(
        _cost, start, args=(error, variance), method="Nelder-Mead", options={"maxiter": 8000, "xatol": 1e-5}
    )
    noise = _noise(best.x)
    strongest = np.abs(error[:, 0])
    return NoiseFit(
        noise=noise,
        profiles=len(used),
        direct_absent=float(noise.absent(variance).mean()),
        strongest_median_rad=float(np.median(strongest)),
        strongest_gross=float((strongest > np.radians(30)).mean()),
    )


def _noise(parameters: FloatArray) -> AoaNoise:
    """Slopes are over the variance's distance from 0.7, its typical value, while fitting."""
    log_sigma, slope, logit, logit_slope, log_ratio = (float(x) for x in parameters)
    return AoaNoise(
        (log_sigma - 0.7 * slope, slope), (logit - 0.7 * logit_slope, logit_slope), float(np.exp(min(log_ratio, 0.0)))
    )


def _cost(parameters: FloatArray, error: FloatArray, variance: FloatArray) -> float:
    """Negative log-likelihood, with a weak pull of the slopes to 0."""
    noise = _noise(parameters)
    sigma, absent = noise.sigma_rad(variance)[:, None], noise.absent(variance)
    there = np.isfinite(error)
    weight = np.where(there, noise.rank_ratio ** np.arange(error.shape[1]), 0.0)
    weight /= weight.sum(axis=1, keepdims=True)
    density = np.exp(-(np.nan_to_num(error) ** 2) / (2 * sigma**2)) / (np.sqrt(2 * np.pi) * sigma)
    likelihood = absent / (2 * np.pi) + (1 - absent) * (weight * density).sum(axis=1)
    return float(-np.log(likelihood + 1e-300).sum() + parameters[1] ** 2 / 50 + parameters[3] ** 2 / 200)


def noise_report(fit: NoiseFit) -> str:
    """The fit as lines for a terminal."""
    noise = fit.noise
    lines = [
        f"{fit.profiles} profiles: strongest peak's median error {np.degrees(fit.strongest_median_rad):.1f} deg,"
        f" over 30 deg in {fit.strongest_gross:.1%}; direct path absent in {fit.direct_absent:.1%}",
        f"AoaNoise(log_sigma=({noise.log_sigma[0]:.3f}, {noise.log_sigma[1]:.3f}),"
        f" logit_absent=({noise.logit_absent[0]:.2f}, {noise.logit_absent[1]:.2f}), rank_ratio={noise.rank_ratio:.3f})",
        "variance   sigma/deg   direct path absent",
    ]
    lines += [f"{v:8.2f} {np.degrees(noise.sigma_rad(v)):11.1f} {noise.absent(v):20.1%}" for v in _VARIANCES]
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> int:
    """Fits all files together, writes the report to standard output."""
    try:
        if not arguments:
            raise InputError("no file given; usage: python -m wiclosure.wiclosure_filter.links.noise_model FILES...")
        profiles = [profile for path in arguments for profile in read_wsr_profiles(path)]
        sys.stdout.write(noise_report(fit_noise_model(profiles)) + "\n")
    except WiclosureError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
