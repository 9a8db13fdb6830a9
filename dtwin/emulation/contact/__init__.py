"""The cell with contact: arm, jaws, trays, belts and boxes are bodies that touch.

Import from the modules: nothing is re-exported here, so that reading options does not load MuJoCo.
"""
