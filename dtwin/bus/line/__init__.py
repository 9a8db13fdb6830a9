"""What is said of a production line on the bus."""
