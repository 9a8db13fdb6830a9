"""How fast the parts are, and what a running cell takes."""
