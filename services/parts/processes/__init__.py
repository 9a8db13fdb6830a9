"""What a service does before it counts as ready."""
