"""How well the twin predicts: accuracy of its motions, and uploads to a cell at work."""
