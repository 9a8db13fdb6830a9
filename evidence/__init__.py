"""Every claim of the project with the command that measures it; part of a checkout, not of the wheel."""
