"""Options of a cluster that do not go together are refused before any work."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from wiclosure.errors import ConfigError
from wiclosure.pipeline.cli.options import Working


def test_without_a_cluster_processes_work_here() -> None:
    with Working(jobs=2).on_cluster() as workers:
        assert workers is None


@pytest.mark.parametrize(
    ("working", "sentence"),
    [
        (Working(cluster_tls="ca.pem,cert.pem,key.pem"), r"--cluster-tls goes with --cluster tls://HOST:PORT"),
        (Working(cluster="local:2", jobs=2), r"-j and --cluster are two ways to work side by side"),
        (Working(cluster="local:2", no_cache=True), r"leave out --no-cache"),
        (Working(cluster="local:2", cluster_tls="ca.pem"), r"--cluster-tls ca\.pem: expected three files"),
    ],
)
def test_options_that_do_not_go_together(working: Working, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence), working.on_cluster():
        pass


def test_what_is_read_is_looked_for_before_workers_start(
    wiclosure: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("wiclosure.pipeline.runtime.cluster.connection.cluster", lambda *_: pytest.fail("started"))
    code, _, err = wiclosure("run", tmp_path / "nowhere", "--cluster", "local:2", "--out", tmp_path / "run")
    assert (code, err.splitlines()) == (
        1, [f"wiclosure: error: recording {tmp_path}/nowhere of robot nowhere does not exist; check the path"],
    )  # fmt: skip
