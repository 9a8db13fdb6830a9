"""Margins of the closed loop of function blocks and arm, linearised at rest and sampled every tick."""
