"""System identification: from experiments to a model of the arm with its uncertainty.

Import from the modules: nothing is re-exported here, so that reading a model file does not load the compiler.
Constants by which a machine is identified from its work were chosen with drawn machines in view whose numbers are in
TUNED of evidence/untouched.py; experiments refuse to be made with these.
"""
