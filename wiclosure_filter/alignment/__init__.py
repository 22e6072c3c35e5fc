"""From two robots' links to how their odometry frames lie."""
