"""Commands that try settings on the twin and upload them."""
