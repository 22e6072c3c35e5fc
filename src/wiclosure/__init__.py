"""Multi-robot LiDAR SLAM that asks the radio where the robots' paths meet."""

__version__ = "0.1.0"
