"""Stations of a line whose arm is another one than the thesis's: any serial arm that sorts."""
