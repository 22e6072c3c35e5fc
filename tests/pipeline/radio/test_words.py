"""Sources as words and entries: what stands behind commas, files of sources, and mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.errors import ConfigError, InputError
from wiclosure.pipeline.radio.words import sources_of_entries, sources_of_words


@pytest.fixture
def log(tmp_path: Path) -> Path:
    (tmp_path / "a.csv").write_text("t,d\n1,2\n")
    return tmp_path / "a.csv"


def test_settings_behind_commas(log: Path) -> None:
    (source,) = sources_of_words([f"{log},unit=mm,robots.7=alpha,robots.12=beta,clockwise=true,range=d"])
    assert (source.path, source.unit, source.clockwise, source.range_) == (log, "mm", True, ("d",))
    assert source.robots == {"7": "alpha", "12": "beta"}


def test_a_path_with_a_comma_is_a_path(tmp_path: Path) -> None:
    (tmp_path / "a,b.csv").write_text("")
    (source,) = sources_of_words([str(tmp_path / "a,b.csv")])
    assert source.path == tmp_path / "a,b.csv"


def test_a_file_of_sources(log: Path) -> None:
    config = log.with_name("radio.yaml")
    config.write_text("- a.csv\n- {path: a.csv, preset: mine.yaml, unit: ft}\n- {topic: /uwb, robots: {1: a}}\n")
    config.with_name("mine.yaml").write_text("unit: mm\nstamp: t\n")
    plain, laid_over, topic = sources_of_words([str(config)])
    assert plain.path == log
    assert (laid_over.unit, laid_over.stamp) == ("ft", ("t",))
    assert (topic.path, topic.topic) == (None, "/uwb")


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ("unit=miles", "unit is 'miles'"),
        ("unti=mm", "unknown key 'unti'; did you mean unit"),
        ("preset=milv", "did you mean miluv"),
        ("range", "range: expected key.path=value"),
        ("x=px", "x and y go together"),
        ("range_limits=3", "range_limits"),
        ("robots=3", "robots"),
        ("time_offset=soon", "time_offset"),
    ],
)
def test_mistakes_are_one_line(log: Path, settings: str, says: str) -> None:
    with pytest.raises((InputError, ConfigError)) as caught:
        sources_of_words([f"{log},{settings}"])
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_entries_must_be_paths_or_mappings(tmp_path: Path) -> None:
    for entry in (3, [["a"]], {"unit": "mm"}):
        with pytest.raises(InputError, match="here"):
            sources_of_entries(entry, tmp_path, "here")
    assert sources_of_entries(None, tmp_path, "here") == ()
