"""A headless run of the cell from the first tick to the last: loop, cell, log."""
