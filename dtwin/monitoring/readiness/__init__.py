"""What a monitor does before it counts as ready."""
