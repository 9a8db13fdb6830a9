"""How an arm is controlled whose gears yield: as fast as usual, or slower, so that their oscillations stay small.

A motor that is ahead of its link meets its rotor alone at the frequencies where both oscillate against each other,
which is less than the inertia that the feedback counts on. A slower observer and slower feedback answer it less.
"""

from __future__ import annotations

from itertools import product
from typing import Final

from dtwin.arm.chain import Arm, holding
from dtwin.controller.chain.application import Control
from dtwin.run.margins.chain import posed_plants

MODULUS: Final = 0.5
"""Least distance of the loop gains from -1: a peak of the sensitivity of 2 (Åström and Murray 2008, 11.1)."""
_POLES: Final = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
"""Poles of the feedback that are tried, in parts of the usual one."""
_OBSERVERS: Final = (1.0, 0.8, 0.6, 0.45)
"""The same of the observers, for each of them."""
_POSES: Final = 6


def control_of(arm: Arm, late: int = 0) -> Control:
    """How an arm is controlled, as its file says.

    Where the file says that gears yield, pole and observer are the first ones with margins of `MODULUS` at drawn
    poses, without a load and with the largest one, or the slowest ones of all if none have them.

    Args:
        arm: the arm as its data sheet says.
        late: ticks from a command until it acts.

    Raises:
        ModelError: a motion of the joints meets no resistance.
    """
    usual = control = Control(delay=min(late, 1) * arm.period)
    if arm.servos or all(joint.transmission is None for joint in arm.joints):
        return usual
    tried = [plant for each in (arm, holding(arm, arm.most_load)) for plant in posed_plants(each, _POSES, late=late)]
    for pole, observer in product(_POLES, _OBSERVERS):
        control = Control(pole * usual.pole, observer * usual.observer, usual.delay)
        short = next((plant for plant in tried if not plant.keeps(control, MODULUS)), None)
        if short is None:
            break
        tried.sort(key=lambda plant: plant is not short)  # that one will most likely be short of it again
    return control
