"""Structured Text to C99 with the results of the Python runtime, bit for bit."""
