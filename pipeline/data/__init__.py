"""Data sets: what users bring, how it is described, opened, written and split."""
