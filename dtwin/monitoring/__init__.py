"""System monitoring: notice that the arm is no longer the arm of the model, and say where, what and how much.

Import from the modules; nothing is re-exported here, so that verdicts can be read without loading the compiler.
"""
