"""Machines: what a real arm has and its equations leave out, in the sections drive, transmission, structure, sensing
and contact.

Import from the modules: nothing is re-exported here, so that reading options does not load MuJoCo.
"""
