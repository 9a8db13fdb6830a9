"""Experiments that measure the monitors: emulated cells with faults, over many seeds."""
