"""One estimate over all robots: where it starts, what it rests on, what comes out."""
