"""Radio logs of any origin: what a source is, how each kind is read, whether a log fits the robots' trajectories."""
