"""Which verdicts of the monitor count."""
