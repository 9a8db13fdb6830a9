"""`dtwin arm ...`: arms as files."""
