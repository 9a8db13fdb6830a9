"""Hypothesis without a deadline, since a first call may compile, and the same examples every time."""

from hypothesis import settings

settings.register_profile("dtwin", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("dtwin")
