"""Identification of a real arm from the motions of its work: parameters and effects, with the data sheet as prior."""
