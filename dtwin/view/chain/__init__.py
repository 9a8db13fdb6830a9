"""Pictures of any serial arm."""
