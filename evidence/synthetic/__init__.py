"""Identification of drawn arms whose numbers are known, from logs with all effects that it has words for."""
