"""Calculations that a page may have made, each in a process of its own."""
