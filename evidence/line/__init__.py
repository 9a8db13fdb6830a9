"""Experiments with the production line."""
