"""Pose graphs of any form as files: what `wiclosure optimize` reads and writes."""
