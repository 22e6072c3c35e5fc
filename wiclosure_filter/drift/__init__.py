"""Odometry frames that drift: a chain of frame transforms, constant errors of links and odometry, and slips."""
