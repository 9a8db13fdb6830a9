"""System monitoring: notice that the arm is no longer the arm of the model, and say where, what and how much.

Import from the modules; nothing is re-exported here, so that verdicts can be read without loading the compiler.
Constants of the monitor of the cell's arm were chosen with drawn machines in view whose numbers are in TUNED of
evidence/untouched.py; experiments refuse to be made with these.
"""
