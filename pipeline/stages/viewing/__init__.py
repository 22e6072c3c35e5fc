"""Who looks at a run while it goes."""
