"""Groups of options as Typer sees them, and what they mean."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from wiclosure.pipeline.cli.options import Configuration, Working, grouped
from wiclosure.pipeline.report.progress_bars import BarProgress
from wiclosure.pipeline.runtime.progress import NoProgress


@dataclass(frozen=True, slots=True)
class Size:
    """A group."""

    length: Annotated[int, typer.Option("--length", "-l")] = 3
    width: Annotated[int, typer.Option("--width")] = 2


@grouped
def area(name: Annotated[str, typer.Argument()], size: Size, times: Annotated[int, typer.Option()] = 1) -> None:
    """Says what came of the words."""
    typer.echo(f"{name}: {times * size.length * size.width}")


def test_a_command_has_the_options_of_its_groups_and_its_own() -> None:
    assert list(inspect.signature(area).parameters) == ["name", "length", "width", "times"]


@pytest.mark.parametrize(
    ("words", "out"),
    [(["a"], "a: 6\n"), (["a", "-l", "5"], "a: 10\n"), (["a", "--width", "1", "--times", "2", "-l", "1"], "a: 2\n")],
)
def test_words_reach_the_group(words: list[str], out: str) -> None:
    app = typer.Typer()
    app.command()(area)
    assert CliRunner().invoke(app, words).stdout == out


def test_the_configuration_of_a_command() -> None:
    config = Configuration("small-site", ["keyframes.distance_m=3"], seed=5).resolved(use_filter="random")
    assert (config.use_filter, config.filter.random.seed) == ("random", 5)
    assert (config.filter.gate.sensor_range_m, config.keyframes.distance_m) == (15.0, 3.0)


def test_quiet_work_shows_nothing_and_work_without_cache_keeps_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path))
    assert isinstance(Working(quiet=True).progress, NoProgress)
    assert isinstance(Working().progress, BarProgress)
    assert Working().cache.folder == tmp_path
    assert Working(no_cache=True).cache.folder is None
