"""Executes networks of function blocks in process."""
