"""What an AI can call."""
