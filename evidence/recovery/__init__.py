"""A fault found and put right by the services alone, and what came of it."""
