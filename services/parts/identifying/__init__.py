"""What services that identify a running arm share: how far they are, and the signal that they have played."""
