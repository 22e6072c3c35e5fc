"""Factors in GTSAM's language: odometry, closures, directions up, fixes, ranges and bearings."""
