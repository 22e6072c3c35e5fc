"""From the wireless log to links between two robots, and the noise of bearings."""
