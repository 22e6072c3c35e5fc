"""Following a robot's scans from one to the next."""
