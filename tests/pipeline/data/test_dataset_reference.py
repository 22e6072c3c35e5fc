"""The reference of dataset.yaml is up to date, and its example is read."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from wiclosure.pipeline.data.dataset_file import read_dataset_file
from wiclosure.pipeline.data.dataset_reference import dataset_reference

PAGE = Path(__file__).resolve().parents[3] / "docs" / "dataset.md"


def test_the_page_is_what_the_keys_say() -> None:
    if not PAGE.parent.is_dir():
        pytest.skip("docs are not part of an installed package")
    assert PAGE.read_text(encoding="utf-8") == dataset_reference(), (
        "write it anew: python -m wiclosure.pipeline.data.dataset_reference > docs/dataset.md"
    )


def test_the_example_is_a_data_set(tmp_path: Path) -> None:
    found = re.search(r"```yaml\n(.*?)```", dataset_reference(), re.DOTALL)
    assert found is not None
    (tmp_path / "dataset.yaml").write_text(found[1])
    (tmp_path / "beta_bag").mkdir()
    for name in ("alpha.bag", "alpha_gt.tum", "radio.jsonl", "uwb.csv"):
        (tmp_path / name).touch()
    robots, wireless = read_dataset_file(tmp_path / "dataset.yaml")
    assert (robots["beta"].time_offset, wireless[1].unit) == (-0.2, "mm")
