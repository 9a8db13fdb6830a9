"""Ticks of headless runs in machine code, as long as nothing happens."""
