from __future__ import annotations

import sys

import pytest

from wiclosure import ConfigError
from wiclosure.display import data_frame


def test_columns_become_a_frame() -> None:
    pytest.importorskip("pandas")
    frame = data_frame({"a": [1, 2], "b": ["x", "y"]})
    assert frame.to_dict("list") == {"a": [1, 2], "b": ["x", "y"]}


def test_without_pandas_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ConfigError, match="pip install pandas"):
        data_frame({"a": [1]})
