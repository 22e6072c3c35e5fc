"""Readers of recordings, one scan in memory at a time."""
