"""What a topic of the bus is."""
