"""Records the events of a network, and repeats them."""
