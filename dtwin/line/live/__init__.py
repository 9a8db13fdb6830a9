"""A line that can be asked while it runs."""
