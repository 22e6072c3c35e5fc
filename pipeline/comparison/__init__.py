"""Arms of a comparison, their statistics and tables, and the paper's experiments."""
