"""Worlds with known truth: scenes, LiDAR rays, radio."""
