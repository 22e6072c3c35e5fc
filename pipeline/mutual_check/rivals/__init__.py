"""Sets of closures, and merged maps, that contradict each other, as where places look alike."""
