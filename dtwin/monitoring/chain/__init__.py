"""Monitoring of any serial arm from logs of other programs."""
