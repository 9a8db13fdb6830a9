"""What a recorder is made of: rows that have come, verdicts, what is drawn of them, and the disk."""
