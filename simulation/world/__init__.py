"""What there is in a simulated world, and what moves in it."""
