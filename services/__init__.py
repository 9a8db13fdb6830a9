"""One process each, joined by Zenoh."""
