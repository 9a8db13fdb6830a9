"""Models of any serial arm for its running blocks: checked on the twin, tried, kept in a history, and taken back."""
