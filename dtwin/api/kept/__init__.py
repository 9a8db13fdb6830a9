"""What a cell keeps: the history of its settings, and its identified models."""
