"""The processes of a production line: its plant, the twins of its zones, and the twin of the line."""
