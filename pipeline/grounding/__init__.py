"""What robots know of the Earth, before they meet: which way is up, and where they are."""
