"""Commands of the production line."""
