"""Radio and closures check each other."""
