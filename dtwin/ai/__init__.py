"""The interface to an AI: it looks at a cell, asks the twin, proposes, and acts through people's doors."""
