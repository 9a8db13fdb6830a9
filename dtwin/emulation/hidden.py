"""What no sensor of a machine tells: what acts in its drives, and what touches in its cell."""

from __future__ import annotations

from dataclasses import dataclass

from dtwin.emulation.contact.touch import Touch
from dtwin.parameters import JointVector


@dataclass(frozen=True, slots=True)
class Drives:
    """Motors, gears and bearings of the three joints.

    Attributes:
        volts: voltages that act on the motors, V: after amplifier, delay and lag, before the back-EMF.
        friction: torques of viscous and dry friction against the motion, N m.
        motors: angles of the motors as seen at the joints, rad.
    """

    volts: JointVector
    friction: JointVector
    motors: JointVector


@dataclass(frozen=True, slots=True)
class Hidden:
    """The hidden truth at a plant time, at the end of what the last command did.

    Attributes:
        drives: motors, gears and bearings; None where they are ideal.
        touch: bodies and contacts; None in a cell without contact.
    """

    drives: Drives | None
    touch: Touch | None
