"""Recordings of a production line."""
