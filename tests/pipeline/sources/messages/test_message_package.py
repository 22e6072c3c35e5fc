from __future__ import annotations

from xml.etree import ElementTree as ET

import pytest

from wiclosure.errors import OutputError
from wiclosure.pipeline.sources.messages.message_package import write_message_package
from wiclosure.pipeline.sources.messages.ros_types import DEFINITIONS


@pytest.fixture
def package(tmp_path):
    return write_message_package(tmp_path / "src")


def test_the_definitions_are_those_that_bags_are_read_by(package):
    assert package.name == "wiclosure_msgs"
    written = {path.stem: path.read_text(encoding="utf-8") for path in (package / "msg").glob("*.msg")}
    assert written == {msgtype.rpartition("/")[2]: text for msgtype, text in DEFINITIONS.items()}


def test_the_manifest_names_whoever_wrote_it(package, monkeypatch, tmp_path):
    monkeypatch.setenv("LOGNAME", "ada")
    manifest = ET.parse(write_message_package(tmp_path / "other") / "package.xml").getroot()
    maintainer = manifest.find("maintainer")
    assert manifest.findtext("name") == "wiclosure_msgs"
    assert maintainer.text == "ada"
    assert maintainer.get("email").startswith("ada@")
    assert "$" not in (package / "package.xml").read_text(encoding="utf-8")


def test_a_package_that_is_there_is_left_alone(package):
    (package / "mine.txt").write_text("mine")
    with pytest.raises(OutputError, match="wiclosure_msgs exists already; remove it first"):
        write_message_package(package.parent)
    assert (package / "mine.txt").read_text() == "mine"
