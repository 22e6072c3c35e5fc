"""What is done with scans: odometry, keyframes, place recognition, registration."""
