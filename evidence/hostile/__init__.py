"""Fuzzing of the device that `dtwin fb run` is: mutated requests and datagrams, and what they do to others."""
