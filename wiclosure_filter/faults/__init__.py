"""Systematic errors of logs and odometry: what they would be, and whether the measurements speak of one."""
