"""How much memory was taken."""

from __future__ import annotations

import sys


def peak_rss_mb() -> float | None:
    """Largest memory of this process so far, or of one that it began and that has ended, MB.

    None where the system does not tell.
    """
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = max(resource.getrusage(whose).ru_maxrss for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6  # Linux counts KiB
