"""The emulated cell: MuJoCo plant, encoders, boxes and faults behind one interface: read, apply, advance.

Import from the modules: nothing is re-exported here, so that reading options does not load MuJoCo.
"""

from typing import Final

from dtwin.parameters import ROOT

MODEL_FILE: Final = ROOT / "models" / "arm.xml"
"""MJCF file of the cell."""
