"""Folders of recordings: what lies in them, a first data set file, what a run would use."""
