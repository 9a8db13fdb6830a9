"""Hypothesis without a deadline: the first call of a kernel compiles it."""

from hypothesis import settings

settings.register_profile("compiled", deadline=None, derandomize=True)
settings.load_profile("compiled")
