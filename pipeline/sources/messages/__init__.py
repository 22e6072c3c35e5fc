"""ROS messages of the sources: decoded and encoded."""
