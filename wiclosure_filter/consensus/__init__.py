"""Finds frame transforms that explain what two robots measured: proposals, scores, peaks of the posterior."""
