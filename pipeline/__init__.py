"""Composes the rooms: sources, runs, comparisons, evaluation, and the command line."""
