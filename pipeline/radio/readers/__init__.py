"""How each kind of radio log is read: rows of raw values, and what they mean."""
