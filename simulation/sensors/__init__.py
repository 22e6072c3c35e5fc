"""What robots in a simulated world measure: LiDAR, IMU, GNSS, radio."""
