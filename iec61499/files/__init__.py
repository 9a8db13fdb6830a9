"""Reads the files that 4diac IDE writes: block types, subapplication types and systems."""
