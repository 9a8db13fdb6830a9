"""What only the services share."""
