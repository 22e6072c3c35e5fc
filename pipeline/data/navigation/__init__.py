"""A robot's inertial measurements and positions on the Earth, as a run takes them."""
