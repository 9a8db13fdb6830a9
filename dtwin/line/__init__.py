"""A production line: cells as stations, vehicles between them, zones that are controlled apart, and their twins."""
