"""Structured Text as Python, for the embedded runtime."""
