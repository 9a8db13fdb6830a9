"""Rules for function blocks: what is right, but hardly meant."""
