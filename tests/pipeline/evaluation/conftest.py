"""Paths with known errors."""

from __future__ import annotations

import pytest

from . import known_paths


@pytest.fixture(scope="session")
def path():
    """See `known_paths.path`."""
    return known_paths.path


@pytest.fixture(scope="session")
def disturbed():
    """See `known_paths.disturbed`."""
    return known_paths.disturbed


@pytest.fixture(scope="session")
def turned():
    """See `known_paths.turned`."""
    return known_paths.turned
