"""Which pairs of keyframes can be near each other: boxes, gates, overlap search."""
