"""Commands that identify the arm."""
