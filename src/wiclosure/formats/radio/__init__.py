"""Radio logs in files, and the units in them."""
