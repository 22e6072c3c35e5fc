"""Relative poses as arrays, their least squares, and which of them are outliers."""
