"""Names from inputs never leave the folder of a result, and act nowhere."""

from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.data.dataset import Dataset
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.stages.run_folder import read_trajectories

NAMES = ["../x", "a/b", "/abs", "..", ".", "-rf", "a" * 255, "new\nline", "<script>", "é", "🤖", "a b", "", "~", "team"]


@pytest.mark.parametrize("name", NAMES)
def test_robots_have_names_that_files_may_have(name: str) -> None:
    with pytest.raises(InputError, match=r"robot name .* cannot be used") as refused:
        Dataset({name: RobotRecording(Path("a.bag"))}, origin=Path("dataset.yaml"))
    assert str(refused.value).startswith("dataset.yaml: ")
    assert len(str(refused.value)) < 300


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "a/b"])
def test_run_folders_of_others_name_nothing_outside_of_them(tmp_path: Path, name: str) -> None:
    (tmp_path / "metrics.json").write_text(f'{{"components": [{{"robots": ["{name}"]}}]}}')
    with pytest.raises(InputError, match="which is no name of a file"):
        read_trajectories(tmp_path)
