"""The ROS 2 package `wiclosure_msgs`, written into a workspace."""

from __future__ import annotations

import getpass
import shutil
import socket
from importlib.resources import as_file
from pathlib import Path
from string import Template

from wiclosure.errors import OutputError
from wiclosure.pipeline.sources.messages.ros_types import MESSAGE_PACKAGE


def write_message_package(folder: Path) -> Path:
    """Writes `wiclosure_msgs` into a folder; its maintainer is whoever writes it, as `ros2 pkg create` has it.

    Returns:
        The package's folder.

    Raises:
        OutputError: it exists already, or cannot be written.
    """
    target = folder / "wiclosure_msgs"
    if target.exists():
        raise OutputError(f"{target} exists already; remove it first, or name another folder")
    user = getpass.getuser()
    try:
        with as_file(MESSAGE_PACKAGE) as package:
            shutil.copytree(package, target)
        manifest = target / "package.xml"
        text = Template(manifest.read_text(encoding="utf-8"))
        filled = text.substitute(name=user, email=f"{user}@{socket.gethostname() or 'localhost'}")
        manifest.write_text(filled, encoding="utf-8")
    except OSError as error:
        shutil.rmtree(target, ignore_errors=True)
        raise OutputError(f"cannot write {target}: {error.strerror or error}; choose another folder") from error
    return target
