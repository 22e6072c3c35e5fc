"""Simulated scenarios as data sets: read while they are made, or written."""
