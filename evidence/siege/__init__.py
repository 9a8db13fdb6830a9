"""Attacks on a cell by somebody who does not know its key."""
