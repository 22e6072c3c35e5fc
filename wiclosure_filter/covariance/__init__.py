"""Covariances of a large pose graph, where they are asked for."""
