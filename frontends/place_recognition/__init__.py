"""Which keyframes look as if they saw the same place."""
