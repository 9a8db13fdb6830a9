"""Commands on a headless cell."""
