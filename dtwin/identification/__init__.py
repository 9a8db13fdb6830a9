"""System identification: from experiments to a model of the arm with its uncertainty.

Import from the modules: nothing is re-exported here, so that reading a model file does not load the compiler.
"""
