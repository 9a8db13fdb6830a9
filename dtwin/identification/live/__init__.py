"""Identification of a running arm of any kind, and where what was found is kept."""
