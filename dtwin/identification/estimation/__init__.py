"""Parameter estimation: the problem, its solver, what the data determine and how good the result is."""
