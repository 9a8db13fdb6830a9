"""The hidden truth of a run: collected tick by tick where a recording shows it, and never on the ideal machine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtwin.emulation.contact.touch import Touch
from dtwin.emulation.hidden import Drives, Hidden

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class DriveColumns:
    """What acted in the drives, each of shape (ticks, 3).

    Attributes:
        volts: voltages that acted on the motors, V.
        friction: torques of friction against the motion, N m.
        motors: angles of the motors as seen at the joints, rad.
    """

    volts: Array
    friction: Array
    motors: Array


@dataclass(frozen=True, slots=True, eq=False)
class TouchColumns:
    """What touched. Rows of contacts and boxes follow one another over all ticks; counts tell how many a tick has.

    Attributes:
        grip: forces of the pads in the order of `Grip`, shape (ticks, 4), N.
        slip: distance of the held box along the pads from where it was gripped, shape (ticks,), m; 0 for no box.
        forces: point (m) and force (N) of every contact, shape (contacts, 6).
        contacts: number of contacts, shape (ticks,).
        poses: centre (m) and quaternion (w, x, y, z) of every box in the cell, shape (boxes, 7).
        colours: colours of these boxes.
        boxes: number of boxes in the cell, shape (ticks,).
    """

    grip: Array
    slip: Array
    forces: Array
    contacts: NDArray[np.int64]
    poses: Array
    colours: tuple[str, ...]
    boxes: NDArray[np.int64]


class HiddenLog:
    """Collects the hidden truth of every tick of a run."""

    def __init__(self) -> None:
        self._drives: list[Drives] = []
        self._touches: list[Touch] = []

    def append(self, hidden: Hidden) -> None:
        """Adds one tick."""
        if hidden.drives is not None:
            self._drives.append(hidden.drives)
        if hidden.touch is not None:
            self._touches.append(hidden.touch)

    @property
    def has_touches(self) -> bool:
        """Whether there are bodies that touch."""
        return bool(self._touches)

    def drives(self) -> DriveColumns | None:
        """What acted in the drives; None where they are ideal."""
        if not self._drives:
            return None
        volts, friction, motors = (
            np.array([getattr(drives, name) for drives in self._drives]) for name in ("volts", "friction", "motors")
        )
        return DriveColumns(volts, friction, motors)

    def touches(self) -> TouchColumns | None:
        """What touched; None in a cell without contact."""
        touches = self._touches
        if not touches:
            return None
        return TouchColumns(
            np.array([touch.grip for touch in touches]),
            _slip([touch.held for touch in touches], np.array([touch.offset for touch in touches])),
            np.concatenate([touch.forces for touch in touches]),
            np.array([len(touch.forces) for touch in touches]),
            np.concatenate([touch.poses for touch in touches]),
            tuple(colour for touch in touches for colour in touch.colours),
            np.array([len(touch.colours) for touch in touches]),
        )


def _slip(held: list[int | None], offsets: Array) -> Array:
    """Distance in the plane of the pads (x and z) from the first tick of each grip, shape (ticks,), m."""
    slip, start = np.zeros(len(held)), 0
    for tick, box in enumerate(held):
        if box is None:
            continue
        if not tick or held[tick - 1] != box:
            start = tick
        x, _, z = offsets[tick] - offsets[start]
        slip[tick] = np.hypot(x, z)
    return slip
