"""Twins in layers: of a station, of a zone, made of its stations' twins, and of the line, which sees zones."""
