"""All robots in one frame: the shared trajectory with its uncertainty."""
