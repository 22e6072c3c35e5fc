from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from wiclosure.errors import OutputError
from wiclosure.pipeline.sources.messages.message_package import write_message_package


def test_the_package_is_whole_and_names_its_maintainer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOGNAME", "ada")
    package = write_message_package(tmp_path / "src")
    maintainer = ET.parse(package / "package.xml").getroot().find("maintainer")
    assert maintainer is not None
    assert maintainer.text == "ada"
    assert maintainer.get("email", "").startswith("ada@")
    assert {path.name for path in package.rglob("*") if path.is_file()} == {
        "package.xml", "CMakeLists.txt", "WirelessMeasurement.msg", "AoaPath.msg", "Heading.msg"
    }  # fmt: skip
    with pytest.raises(OutputError, match="exists already"):
        write_message_package(tmp_path / "src")
