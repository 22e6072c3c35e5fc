"""Files that users and other programs read and write."""
