"""The vehicles of a line as a fleet under VDA 5050: orders go to them, and their states come back."""
