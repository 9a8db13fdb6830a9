"""What passes on the bus of a cell whose arm is another one than the thesis's."""
