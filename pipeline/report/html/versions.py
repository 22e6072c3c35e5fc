"""Versions of what the figures depend on, to reproduce them."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

from wiclosure.version import __version__

_PACKAGES = ("numpy", "scipy", "gtsam", "kiss-icp", "small-gicp", "open3d", "rosbags")


def versions() -> dict[str, str]:
    """Of this program, of Python and of what the figures depend on."""
    found = {"wiclosure": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
