"""Measurements of any arm: files of other programs, what their columns mean, what is odd, what was repaired."""
