"""Inertial measurements: which way is up at the keyframes, where the IMU is mounted, and whether it can be believed."""
