"""What is made of function blocks once, and kept on disk for every process that comes after."""
