"""Inertial measurements and positions on the Earth, as topics of bags, tables and KITTI's OXTS files."""
