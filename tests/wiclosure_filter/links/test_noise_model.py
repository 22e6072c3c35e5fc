"""The noise model of bearings: recovered from profiles made by it, fitted to real ones by one command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.formats.radio.wsr import AoaNoise, WsrProfile
from wiclosure.wiclosure_filter.links.noise_model import fit_noise_model, main


def made_by(noise: AoaNoise, count: int) -> list[WsrProfile]:
    rng = np.random.default_rng(3)
    profiles = []
    for _ in range(count):
        variance = float(rng.uniform(0.5, 1.1))
        azimuth = rng.uniform(-np.pi, np.pi, 3)
        true = float(rng.uniform(-np.pi, np.pi))
        if rng.random() > noise.absent(variance):
            weight = noise.rank_ratio ** np.arange(3)
            azimuth[rng.choice(3, p=weight / weight.sum())] = true + rng.normal(0, noise.sigma_rad(variance))
        profiles.append(WsrProfile("1", "r", "t", variance, azimuth, None, true))
    return profiles


def test_the_model_that_made_the_profiles_is_found() -> None:
    noise = AoaNoise((-2.5, 0.8), (-5.0, 4.0), 0.4)
    fit = fit_noise_model(made_by(noise, 3000))
    assert fit.noise.rank_ratio == pytest.approx(0.4, abs=0.06)
    for variance in (0.6, 0.8, 1.0):
        assert float(fit.noise.sigma_rad(variance)) == pytest.approx(float(noise.sigma_rad(variance)), rel=0.12)
        assert float(fit.noise.absent(variance)) == pytest.approx(float(noise.absent(variance)), abs=0.06)


def test_too_few_profiles_are_refused() -> None:
    with pytest.raises(InputError, match="at least 20"):
        fit_noise_model(made_by(AoaNoise(), 3))


def test_one_command_fits_real_files(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(file) for file in sorted((data_dir / "wifi_aoa").glob("*.json"))]) == 0
    printed = capsys.readouterr().out
    assert "588 profiles" in printed
    assert "direct path absent in 5.1%" in printed


def test_errors_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 1
    assert main(["nowhere.json"]) == 1
    assert len(capsys.readouterr().err.splitlines()) == 2
