"""Where can trajectories of different robots meet?  Asks the radio, before any scan is compared."""
