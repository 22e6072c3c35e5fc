"""What stages stand on: cache, processes, progress, output that is whole or absent, log."""
