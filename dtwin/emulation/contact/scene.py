"""What a cell with contact adds to the MuJoCo model of the arm: belts, boxes, and pads that grip.

MuJoCo knows no moving surface, so a belt is a body on a slide along its direction. It is so heavy that boxes do not
slow it; its speed is set, and its position is set back to zero before it has moved by more than some millimetres.
Boxes that are not in the cell are parked beside it, without weight and without contact.

Solver, cone and time constants were chosen by measurements, which docs/contact.md gives.
"""

from __future__ import annotations

from typing import Final

import mujoco

from dtwin.emulation.machine.sections import Contact
from dtwin.parameters import PLACES, Point

BELTS: Final[dict[str, tuple[float, float, float]]] = {
    "pickup": (-1.0, 0.0, 0.0),
    **dict.fromkeys(PLACES, (0.0, -1.0, 0.0)),
}
"""Directions in which the belts carry, by the places that they serve."""
BOXES: Final = 6
"""Number of bodies for boxes, which are used again and again."""
HALF: Final = 0.018
"""Half the edge of a box, m."""
FIXED_PADS: Final = tuple(f"fixed_pad_{i}" for i in (1, 2, 3, 4))
MOVING_PADS: Final = tuple(f"jaw_pad_{i}" for i in (1, 2, 3, 4))
ARM_BIT: Final = 1
CELL_BIT: Final = 2
BOX_BIT: Final = 4
"""Bits of contype and conaffinity in the file: which geoms touch which."""

_BELT_MASS: Final = 1000.0
"""kg: 10 N change the speed of such a belt by 0.1 mm/s in a tick of 10 ms."""
_IMPEDANCE_RATIO: Final = 100.0
"""How much harder friction is than the normal direction: a box at rest in the grip sinks by less than 10 um/s."""


def belt_name(place: str) -> str:
    """Name of the body of the belt at a place, and of its slide joint."""
    return f"{place}_belt"


def box_name(index: int) -> str:
    """Name of the body of a box, of its joint and of its geom."""
    return f"box_{index}"


def parking_space(index: int) -> Point:
    """Where a box that is not in the cell is kept, m."""
    return (1.0 + 0.1 * index, 1.5, 0.0)


def add_bodies(spec: mujoco.MjSpec, settings: Contact, step: float) -> None:
    """Adds belts and boxes to the model of the cell, and chooses how contact is integrated.

    Args:
        spec: model of the cell with the names of models/arm.xml, which is changed.
        settings: friction of pads and bodies.
        step: integration step, s.
    """
    for geom in spec.geoms:
        geom.friction[0] = settings.friction
    for place, direction in BELTS.items():
        belt = spec.body(belt_name(place))
        belt.add_joint(name=belt_name(place), type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction)
        belt.mass, belt.inertia, belt.explicitinertial = _BELT_MASS, (1.0, 1.0, 1.0), True
    for index in range(BOXES):
        box = spec.worldbody.add_body(name=box_name(index), pos=parking_space(index), gravcomp=1.0)
        box.add_freejoint(name=box_name(index))
        geom = box.add_geom(name=box_name(index), type=mujoco.mjtGeom.mjGEOM_BOX, size=(HALF, HALF, HALF), mass=0.2)
        geom.contype = geom.conaffinity = 0
        geom.friction[0] = settings.friction
    _pair_pads(spec, settings, step)
    option = spec.option
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = _IMPEDANCE_RATIO
    option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)


def _pair_pads(spec: mujoco.MjSpec, settings: Contact, step: float) -> None:
    """Pairs every pad with every box.

    Only pairs have a time constant of their own for friction. At 2 steps, a sliding speed below the friction limit is
    gone after one step.
    """
    for pad in (*FIXED_PADS, *MOVING_PADS):
        geom = spec.geom(pad)
        geom.contype = geom.conaffinity = 0
        for index in range(BOXES):
            pair = spec.add_pair(geomname1=pad, geomname2=box_name(index), condim=3)
            pair.friction[:2] = settings.pad_friction
            pair.solreffriction = (2.0 * step, 1.0)
