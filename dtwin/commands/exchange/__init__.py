"""Commands that hand models to other simulators."""
