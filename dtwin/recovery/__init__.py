"""What follows from a finding of the monitor: the table of answers, and the operator who gives them over the bus."""
