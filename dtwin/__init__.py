"""A digital twin of a box-sorting arm controlled by IEC 61499 function blocks."""

__version__ = "0.1.0"
