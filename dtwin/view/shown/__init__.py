"""A run shown to people: a recording opened where it is worth a look, and a film of a log."""
