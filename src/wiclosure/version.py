"""The version: here, so that what lies below the public API can name it."""

__version__ = "0.1.0"
