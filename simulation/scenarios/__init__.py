"""The scenarios: each a world, robots and the paths that they drive."""
