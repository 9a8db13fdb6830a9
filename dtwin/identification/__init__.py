"""System identification: from an experiment to a model that knows how well it knows itself.

Import from the modules; nothing is re-exported here, so that reading a model file does not load the compiler.
"""
