"""The range of every number that can be set in an FMU: its description names it, and its C code refuses the rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from dtwin.controller.bounds import ENCODER_OFFSETS, HIGHEST_GAINS, MODEL_RANGES, PAYLOADS, TARGET_TIMES
from dtwin.controller.settings import COMPENSATION_RANGES, LAWS, MOST_REPEATS
from dtwin.errors import FunctionBlockError
from dtwin.task import MOST_PLACES

Range = tuple[float, float]
"""Least and greatest value."""
ANGLES: Final[Range] = (-1e3, 1e3)
"""An angle, rad: 159 turns."""
VELOCITIES: Final[Range] = (-1e3, 1e3)
"""A velocity at the start, rad/s."""
VOLTAGES: Final[Range] = (-1e6, 1e6)
"""A voltage, V: what a motor cannot take is clipped, so that a strong law of another maker is not refused."""
MASSES: Final[Range] = (0.0, 100.0)
"""The mass of a load, kg."""
ARM_RANGES: Final[Mapping[str, Range]] = {
    "K": (1e-4, 1e2),
    "m": (1e-4, 1e2),
    "I": (1e-7, 1e1),
    "l": (1e-3, 1e1),
    "c": (0.0, 1e1),
    "D": (0.0, 1e2),
    "mu": (0.0, 1e2),
}
"""A parameter of an arm that is simulated, by its symbol, SI units: far more than any arm of this kind has."""
COULOMB_WIDTHS: Final[Range] = (1e-6, 1e2)
"""Velocity over which Coulomb friction changes sign, rad/s."""
STEPS: Final[Range] = (1e-5, 1.0)
"""Longest step of the integration, s."""
LONGEST_DURATION: Final = 3600.0
"""Longest communication step, s, so that every call ends."""
FARTHEST_TIME: Final = 1e10
"""Greatest time, s, in either direction: 317 years, whose rounding of 2 us is far less than a tick."""

_OF_BLOCKS: Final[Mapping[str, Range]] = {
    "CONTROLLER.LAW": (0, len(LAWS) - 1),
    "CONTROLLER.PAYLOAD_MASS": PAYLOADS,
    "CONTROLLER.DEAD_ZONE": COMPENSATION_RANGES["dead_zone"][:2],
    "OBSERVER.DELAY": COMPENSATION_RANGES["delay"][:2],
    "OBSERVER.BANDWIDTH": COMPENSATION_RANGES["bandwidth"][:2],
    "DETECTOR.CONFIRM": (0, 100),
    "OBSERVER.GATE": (0.0, math.pi),
    "OBSERVER.REPEATS": (0, MOST_REPEATS),
    "OBSERVER.PULL": (1e-3, 1.0),
    "SEQUENCE.WIDENED": (1.0, 100.0),
    "PLANNER.T": TARGET_TIMES,
    "SEQUENCE.BOX_ANGLE": (0.0, math.pi),
    **{f"CONTROLLER.{name.upper()}": (0.0, highest) for name, highest in HIGHEST_GAINS.items()},
    **{f"CONTROLLER.{symbol.upper()}": bounds for symbol, bounds in MODEL_RANGES.items()},
    "ENCODERS.OFFSET": ENCODER_OFFSETS,
    "SEQUENCE.PICKUP": ANGLES,
    **{f"SEQUENCE.PLACE{place}_": ANGLES for place in range(1, MOST_PLACES + 1)},
}


def range_of_setting(name: str) -> Range:
    """The range of a number that is an input of a block that holds settings, `BLOCK.INPUT`.

    Raises:
        FunctionBlockError: there is none.
    """
    for known in (name, name.rstrip("123")):
        if known in _OF_BLOCKS:
            return _OF_BLOCKS[known]
    raise FunctionBlockError(f"{name}: expected an input of a block whose range is known")
