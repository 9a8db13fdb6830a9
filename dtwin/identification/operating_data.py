"""Identification from routine operating data: pieces of the usual motions with an empty gripper.

Where all but a few parameters of the arm are known, these few can be estimated from the motions of its usual work,
without an identification signal. Motions with a box are left out, since the mass of the box is not known.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from dtwin.bus.messages import Acted
from dtwin.bus.ticks import Tick, Ticks
from dtwin.errors import IdentificationError
from dtwin.identification.data import Experiment
from dtwin.identification.estimation.estimate import Estimate, EstimationSettings, identify
from dtwin.identification.estimation.problem import Prior
from dtwin.identification.held_out import compare
from dtwin.identification.model import IdentifiedModel
from dtwin.identification.result import from_estimate
from dtwin.parameters import ArmParameters
from dtwin.signals import Sensors, Voltages

MEMORY: Final = 6000
"""Number of ticks that are remembered."""
PIECE: Final = 75
"""Length of a piece, ticks; each has its own initial state and is long enough to tell a velocity from noise."""
PIECES: Final = 3
"""Number of pieces that an estimation needs; the last one judges the model fitted to the others."""
MOVED: Final = 0.1
"""Least range of the angle of some joint in a piece, rad: an arm at rest tells nothing about friction."""


class OperatingData:
    """The last ticks of a running cell: its samples and what acted on the arm after them."""

    def __init__(self) -> None:
        self._incoming = Ticks()
        self._ticks: deque[Tick] = deque(maxlen=MEMORY)

    def take(self, item: Sensors | Voltages | Acted) -> None:
        """Takes a sample, a command or what acted instead of one; commands may come before or after their samples."""
        if isinstance(item, Sensors) and self._ticks and item.sequence <= self._ticks[-1][0].sequence:
            self._ticks.clear()  # another run has begun
        self._ticks.extend(self._incoming.take(item))

    def pieces(self, since: float) -> list[Experiment]:
        """Pieces of motion with an empty gripper that began at a plant time (s) or later, oldest first."""
        found = []
        run: list[Tick] = []
        for sensors, acted in self._ticks:
            if acted.box_gripped or sensors.time < since:
                run.clear()
                continue
            if run and sensors.sequence != run[-1][0].sequence + 1:
                run.clear()
            run.append((sensors, acted))
            if len(run) == PIECE:
                piece = Experiment([s.theta for s, _ in run], [a.volts[:3] for _, a in run])
                if float(np.ptp(piece.measured, axis=0).max()) > MOVED:
                    found.append(piece)
                run.clear()
        return found


def renewed(
    known: ArmParameters, errors: dict[str, float], free: Sequence[str], anew: Sequence[str]
) -> EstimationSettings:
    """Settings that estimate some parameters of an identified arm again.

    Args:
        known: parameters of the arm as they were identified.
        errors: standard errors of the identified parameters by name, SI units.
        free: names of the parameters to estimate; those without a standard error stay fixed unless in `anew`.
        anew: names of the parameters whose old values no longer count; all of `free` when empty.

    Raises:
        IdentificationError: a name in `anew` is not free.
    """
    unknown = tuple(anew) or tuple(free)
    if strangers := [name for name in unknown if name not in free]:
        raise IdentificationError(f"--anew {strangers[0]}: expected some of the free parameters, {', '.join(free)}")
    priors = {name: Prior(known.get(name), errors[name]) for name in free if name not in unknown and name in errors}
    return EstimationSettings(tuple(name for name in free if name in unknown or name in priors), known, priors=priors)


def estimate_from(
    pieces: Sequence[Experiment], settings: EstimationSettings, source: str
) -> tuple[Estimate, IdentifiedModel]:
    """Estimates from all pieces but the last, which judges the model.

    Args:
        pieces: pieces of motion, at least PIECES.
        settings: what to estimate and how.
        source: description of the data in words.

    Raises:
        IdentificationError: there are too few pieces, or they tell too little.
    """
    if len(pieces) < PIECES:
        raise IdentificationError(f"expected at least {PIECES} pieces of motion, got {len(pieces)}")
    *known, last = pieces
    estimate = identify(known, settings)
    fit = compare([last], estimate.parameters, estimate.problem.offset(estimate.x)).fit
    return estimate, from_estimate(estimate, fit, source)
