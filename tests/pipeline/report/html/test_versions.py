from __future__ import annotations

import platform
from importlib.metadata import distributions

import numpy as np
import scipy

from wiclosure.pipeline.report.html.versions import versions
from wiclosure.version import __version__


def test_versions_are_those_of_the_modules_in_use():
    found = versions()
    assert found["wiclosure"] == __version__
    assert found["python"] == platform.python_version()
    assert found["numpy"] == np.__version__
    assert found["scipy"] == scipy.__version__


def test_only_what_is_installed_is_named_with_its_version():
    installed = {each.name.lower().replace("_", "-"): each.version for each in distributions()}
    packages = {name: version for name, version in versions().items() if name not in {"wiclosure", "python"}}
    assert {"gtsam", "kiss-icp", "rosbags"} <= packages.keys()
    assert all(installed[name] == version for name, version in packages.items())
