"""The emulated cell: MuJoCo plant, encoders, boxes and faults behind one interface: read, apply, advance."""

from dtwin.emulation.emulation import Emulation, EmulationState
from dtwin.emulation.encoders import NOISE_KINDS, NoiseKind
from dtwin.emulation.faults import Fault, parse_fault
from dtwin.emulation.plant import MODEL_FILE, Plant

__all__ = ["MODEL_FILE", "NOISE_KINDS", "Emulation", "EmulationState", "Fault", "NoiseKind", "Plant", "parse_fault"]
