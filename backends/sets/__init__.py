"""Sets of closures between two groups of robots: which agree, and whether chance explains it."""
