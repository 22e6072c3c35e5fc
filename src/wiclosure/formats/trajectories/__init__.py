"""Trajectories in files: TUM, EuRoC, KITTI poses."""
