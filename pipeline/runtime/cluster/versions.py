"""What must be the same on all machines that work for one run."""

from __future__ import annotations

import platform
from typing import TypeAlias

from wiclosure.pipeline.runtime.cache import code_digest, library_version
from wiclosure.version import __version__

VersionsOf: TypeAlias = dict[str, str]

_LIBRARIES = ("numpy", "scipy", "gtsam", "kiss-icp", "small-gicp", "kiss-matcher", "open3d", "rosbags", "dask")
_PACKAGES = ("wiclosure", "frontends", "wiclosure_filter", "backends", "simulation", "pipeline")


def versions() -> VersionsOf:
    """Of Python, this package and its code, and the libraries that compute."""
    own = tuple(name if name == "wiclosure" else f"wiclosure.{name}" for name in _PACKAGES)
    return {
        "Python": ".".join(platform.python_version_tuple()[:2]),
        "wiclosure": f"{__version__} (code {code_digest(own)[:8]})",
        **{library: library_version(library) for library in _LIBRARIES},
    }
