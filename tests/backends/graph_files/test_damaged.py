"""Files that are cut, mixed up, or hold impossible numbers are read as far as they can be, or refused in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.backends.graph_files.team import read_graphs
from wiclosure.errors import InputError

WORDS = [
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e200",
    "1e-320",
    "0",
    "-1",
    "1,5",
    "x",
    "",
    "18446744073709551615",
    "9" * 40,
    "#",
]


def damage(text, rng):
    """One to five mistakes in words and lines."""
    lines = text.splitlines()
    for _ in range(rng.integers(1, 6)):
        n, m = rng.integers(0, len(lines), 2)
        words = lines[n].split(" ")
        word = int(rng.integers(0, len(words)))
        match int(rng.integers(0, 8)):
            case 0 | 1 | 2:
                words[word] = str(rng.choice(WORDS))
                lines[n] = " ".join(words)
            case 3:
                lines[n], lines[m] = lines[m], lines[n]
            case 4:
                lines[n] = lines[n][: rng.integers(0, len(lines[n]) + 1)]
            case 5:
                lines[n] = lines[m]
            case 6:
                other = lines[m].split(" ")
                words[word] = other[min(word, len(other) - 1)]
                lines[n] = " ".join(words)
            case _:
                del lines[n]
                lines = lines or [""]
    return "\n".join(lines)[: rng.integers(0, 2) * 10**9 or rng.integers(0, len(text) + 1)]


def require_read_or_refused(path):
    try:
        team = read_graphs([path])
    except InputError as error:
        refused = str(error)
    else:
        refused = ""
    if refused:
        assert "\n" not in refused
        assert path.name in refused
        return
    assert all(np.isfinite(t.poses).all() for t in team.odometry.values())
    for trajectory in team.odometry.values():
        i, j = np.zeros(len(trajectory), np.int64), np.arange(len(trajectory))
        assert np.isfinite(trajectory.relative_covariance(i, j)).all()
    assert all(np.isfinite(c.measured.covariance).all() for c in team.closures)
    assert sum(map(len, team.odometry.values())) == len(np.concatenate(list(team.keys.values())))


@pytest.mark.parametrize("form", ["symbols", "labelled", "interleaved", "toro3", "toro2", "planar, interleaved"])
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_damaged_text_is_read_or_refused(form, forms, tmp_path_factory, seed):
    _, (path,) = forms.written(form, 5, tmp_path_factory.mktemp("damaged"))
    path.write_text(damage(path.read_text(), np.random.default_rng(seed)))
    require_read_or_refused(path)


@pytest.mark.parametrize("form", ["robot log", "planar robot log"])
@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_damaged_robot_logs_are_read_or_refused(form, forms, tmp_path_factory, seed):
    _, (path,) = forms.written(form, 5, tmp_path_factory.mktemp("damaged"))
    path.write_text(damage(json.dumps(json.loads(path.read_text()), indent=1), np.random.default_rng(seed)))
    require_read_or_refused(path)


@pytest.mark.parametrize("value", [None, [], {}, "x", 1e400, -1, [[1]], True, {"type": "Pose3"}])
def test_any_value_in_a_robot_log_may_be_another(forms, tmp_path, value):
    """Each value of the log in turn is replaced by one of another kind."""
    _, (path,) = forms.written("robot log", 5, tmp_path, n_loops=2)
    text = path.read_text()

    def places(node, way=()):
        yield way
        children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
        for key, child in children:
            if not isinstance(key, int) or key < 2:  # the first of a list tell for the others
                yield from places(child, (*way, key))

    for way in places(json.loads(text)):
        log = {"root": json.loads(text)}
        node = log
        for key in ("root", *way)[:-1]:
            node = node[key]
        node[("root", *way)[-1]] = value
        path.write_text(json.dumps(log["root"]))
        require_read_or_refused(path)
