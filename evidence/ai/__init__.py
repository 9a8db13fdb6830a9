"""What the interface to an AI must show, measured on cells of its own."""
