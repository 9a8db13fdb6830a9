"""Logs of real robots, beside other tools on the same files."""
