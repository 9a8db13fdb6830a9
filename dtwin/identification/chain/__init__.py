"""Identification of any serial arm from measured motion."""
