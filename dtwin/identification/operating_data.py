"""Identification from routine operating data: pieces of the usual motions with an empty gripper.

Where all but a few parameters of the arm are known, these few can be estimated from the motions of its usual work,
without an identification signal. Motions with a box are left out, since the mass of the box is not known.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

from dtwin.bus.ticks import Tick

if TYPE_CHECKING:
    from dtwin.identification.data import Experiment

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
        self._ticks: deque[Tick] = deque(maxlen=MEMORY)

    def extend(self, ticks: Iterable[Tick]) -> None:
        """Takes ticks, oldest first."""
        for tick in ticks:
            if self._ticks and tick[0].sequence <= self._ticks[-1][0].sequence:
                self._ticks.clear()  # another run has begun
            self._ticks.append(tick)

    def pieces(self, since: float) -> list[Experiment]:
        """Pieces of motion with an empty gripper that began at a plant time (s) or later, oldest first."""
        from dtwin.identification.data import Experiment  # loads the compiled twin, which remembering does without

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
                angles = [s.theta for s, _ in run]
                if max(max(joint) - min(joint) for joint in zip(*angles, strict=True)) > MOVED:
                    found.append(Experiment(angles, [a.volts[:3] for _, a in run]))
                run.clear()
        return found
