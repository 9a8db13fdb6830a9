"""Proposals of an AI on the bus: how they are made, seen and decided."""
