"""What touches in a cell with contact, and with which forces, read from MuJoCo's contacts of the last step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.parameters import Point


class Grip(NamedTuple):
    """The forces of the pads on boxes.

    Attributes:
        fixed: force with which the fixed pads press, N.
        moving: force with which the moving pads press, N.
        tangential: sum of the forces along the pads, N: what friction carries.
        bearable: largest tangential force that friction bears, N.
    """

    fixed: float
    moving: float
    tangential: float
    bearable: float


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """The bodies that move freely, and what touches.

    Attributes:
        forces: a row for each contact, shape (contacts, 6): the point (m), and the force there (N) on the box, on the
            arm where no box takes part.
        grip: forces of the pads.
        colours: colours of the boxes in the cell.
        poses: their poses, shape (boxes, 7): centre (m) and unit quaternion (w, x, y, z).
        held: number of the box between the pads, None for no box.
        offset: position of that box in the frame of the tip, m; x and z lie in the plane of the pads.
    """

    forces: NDArray[np.float64]
    grip: Grip
    colours: tuple[str, ...]
    poses: NDArray[np.float64]
    held: int | None
    offset: Point
