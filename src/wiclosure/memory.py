"""How much memory this process has taken."""

from __future__ import annotations

import sys


def peak_rss_mb() -> float | None:
    """Largest memory of this process so far, MB; None where the system does not tell."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6  # Linux counts KiB
