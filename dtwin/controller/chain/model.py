"""Which inputs of the blocks of an arm hold its model and its tuning, so that they can be changed while they run.

Nothing but the event INIT brings these values from a joint to the blocks in it, and that begins anew. So they are
written where they are read, between two samples.
"""

from __future__ import annotations

from typing import Final

from dtwin.arm.chain import Arm, Array
from dtwin.controller.chain.application import Control, inputs, joint_name

_HELD: Final = {
    "PATH": ("SPEED", "ACCELERATION"),
    "OBSERVER": ("BANDWIDTH", "KINK", "WIDTH", "STICKS", "AGAINST"),
    "FEEDBACK": ("KP", "KI", "KD"),
    "LINK": ("M", "HX", "HY", "HZ", "JXX", "JXY", "JYY", "JXZ", "JYZ", "JZZ"),
    "DRIVE": ("TORQUE_CONSTANT", "LARGEST", "ROTOR", "VISCOUS", "COULOMB", "SHARE", "INERTIA"),
}
"""Inputs by the block in CHAIN_JOINT that reads them."""


def held_inputs(arm: Arm, inertia: Array, control: Control) -> dict[str, float]:
    """The values of the inputs with model and tuning, by `JOINT_K.BLOCK.INPUT`.

    A path has the speed and acceleration with which it began until its end.

    Args:
        arm: the arm with the model.
        inertia: usual inertia of every joint with all that it carries, (n,), kg m^2.
        control: how it is controlled.

    Raises:
        ModelError: something of the arm is not known; names it.
    """
    given = inputs(arm, inertia, control, None)
    return {
        f"{joint}.{block}.{name}": float(given[f"{joint}.{name}"])
        for joint in map(joint_name, range(len(arm)))
        for block, names in _HELD.items()
        for name in names
    }
