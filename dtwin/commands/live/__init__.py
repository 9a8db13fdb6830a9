"""Commands on a cell that is up as services."""
