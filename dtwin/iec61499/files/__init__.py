"""Reads type, system and mapping files."""
