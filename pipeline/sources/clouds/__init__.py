"""Clouds in single files, a module a format."""
