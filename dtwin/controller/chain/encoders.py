"""What an encoder of a joint may read, by its data sheet: the numbers by which a block believes its readings."""

from __future__ import annotations

from math import ceil, erf, isfinite, log, sqrt
from typing import Any, Final

from dtwin.arm.chain import Arm
from dtwin.controller.chain.joints import WIDE

DOUBTED: Final = 12.0
"""Count of disbelieved readings of a joint beyond which the arm is stopped, and its brake engaged."""
GATE: Final = 0.05
"""Distance by which an encoder may suddenly read too much or too little, rad or m, so that the arm works on."""
_STEPS, _NOISES, _MOTION = 3.0, 10.0, 1e-3
"""What an encoder shows in any case: so many steps and deviations of its noise, and that motion, rad or m."""
_HELD: Final = 4.0
"""Change of a torque, in parts of the dry friction, that friction twice as strong holds either way."""
_PRESSED: Final = 0.2
"""Time for which a joint may stand although its command has grown by what its dry friction holds either way, s."""
_CARRIED: Final = 0.5
"""Torque that a gear carries at most for long, in parts of the largest one of its drive."""
_LEAST: Final = 2.0
"""Acceleration that counts as held also where the data sheet has no dry friction, rad/s^2 or m/s^2."""
_SHARE: Final = 0.5
"""Torque from outside that pushes a joint, in parts of the largest one of its drive."""
_RESTS: Final = 8e-4
"""Distance from its path, rad or m, that a joint whose reading stays may keep, less than any task needs."""
_TURNED: Final = 0.2
"""Acceleration against a growing command, in parts of what friction and a push together give, that is no push."""
_LIVELY: Final = 0.6
"""Least noise in parts of the step with which an encoder shows it in every place."""
_CHANCE: Final = 1e-12
"""Probability of a row of equal readings that does not happen."""


def belief(arm: Arm, k: int, inertia: float) -> dict[str, Any]:
    """The values of the inputs by which a joint believes its encoder.

    Args:
        arm: the arm.
        k: number of the joint, from 0.
        inertia: its usual inertia with all that it carries, kg m^2 or kg.
    """
    joint, noise, period = arm.joints[k], arm.tolerances.noise, arm.period
    step, gear, largest = joint.step, joint.transmission, joint.largest
    known = largest if isfinite(largest) else 0.0
    dry = joint.friction.coulomb + joint.friction.load * _CARRIED * known
    sticks = max(_HELD * dry / inertia, _LEAST)
    seen = _NOISES * sqrt(6.0) * noise + 2.0 * step  # a second difference has six times the variance
    play = 0.0 if gear is None else gear.backlash + 2.0 * known / gear.stiffness
    pushed = min(sticks + _SHARE * largest / inertia, WIDE)
    return {
        "GATE": GATE,
        "KINK": min(period**2 * pushed, GATE) + seen + play,
        "WIDTH": _MOTION + _STEPS * step + _NOISES * noise + play,
        "STICKS": sticks,
        "AGAINST": WIDE if arm.servos else _TURNED * pushed + seen / period**2,
        "TURN": max(2.0 * step, noise) if noise > 0.0 else WIDE,
        "REPEATS": repeats(step, noise),
        "PRESSES": ceil(_PRESSED / period),
        "NEAR": max(_STEPS * step, _RESTS),
    }


def repeats(step: float, noise: float) -> int:
    """How often in a row an encoder never gives the same reading at rest; 0 where its noise does not say.

    In the middle of a step a reading is repeated with the largest probability, p = erf(step / (2 sqrt(2) noise)).

    Args:
        step: step of the encoder, rad or m; 0 for one without.
        noise: standard deviation of its noise, rad or m.
    """
    if noise <= 0.0 or noise < _LIVELY * step:
        return 0
    same = erf(step / (2.0 * sqrt(2.0) * noise))
    return 3 if same <= 0.0 else max(3, ceil(log(_CHANCE) / log(same)))
