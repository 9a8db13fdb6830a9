"""The samples of one arm as they come, one by one or many at once."""
