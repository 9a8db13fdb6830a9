"""The proposals of an AI at the simulation service."""
