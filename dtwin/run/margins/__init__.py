"""Margins of the closed loop of blocks and any arm, and what control follows from them where gears yield."""
