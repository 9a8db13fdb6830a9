"""What the encoders' readings tell by themselves, and what their noise is like."""
