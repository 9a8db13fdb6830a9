"""Alarm management after IEC 62682 and ISA-18.2: states, list, journal, and what of a cell is an alarm."""
