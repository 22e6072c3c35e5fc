"""Does a radio log fit the robots' trajectories: units, clock, axes; what is suspected, and how to correct it."""
