"""Which inputs of the blocks of an arm hold its model, so that it can be changed while they run.

Nothing but the event INIT brings these values from a joint to the blocks in it, and that begins anew. So they are
written where they are read, between two samples.
"""

from __future__ import annotations

from typing import Final

from dtwin.arm.chain import Arm, Array
from dtwin.controller.chain.application import Control, inputs, joint_name

_HELD: Final = {
    "LINK": ("M", "HX", "HY", "HZ", "JXX", "JXY", "JYY", "JXZ", "JYZ", "JZZ"),
    "DRIVE": ("TORQUE_CONSTANT", "LARGEST", "ROTOR", "VISCOUS", "COULOMB", "SHARE", "INERTIA"),
}
"""Inputs by the block in CHAIN_JOINT that reads them."""


def model_inputs(arm: Arm, inertia: Array) -> dict[str, float]:
    """The values of the inputs with the model, by `JOINT_K.BLOCK.INPUT`.

    Args:
        arm: the arm with the model.
        inertia: usual inertia of every joint with all that it carries, (n,), kg m^2.

    Raises:
        ModelError: something of the arm is not known; names it.
    """
    given = inputs(arm, inertia, Control(), None)
    return {
        f"{joint}.{block}.{name}": float(given[f"{joint}.{name}"])
        for joint in map(joint_name, range(len(arm)))
        for block, names in _HELD.items()
        for name in names
    }
