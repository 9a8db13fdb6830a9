"""What passes between the services and the blocks of the controller."""
