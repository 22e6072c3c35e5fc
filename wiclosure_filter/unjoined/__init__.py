"""Robots that nothing joins for certain: what the radio still rules out."""
