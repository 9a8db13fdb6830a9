"""What the estimator's state vector holds, and in which units.

The state is what moves (q, w), what the model believes of the arm (K, D, mu, c, I), the mass in the gripper, by how
much the commands come later and which share of the voltages comes in addition, torques that the model does not
explain, and what the encoders add to the truth: an offset, and the rate at which it grows: with time, or, of an
encoder that is believed to read larger angles than there are, with the angle.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

NAMES: Final = (
    *(f"{symbol}{joint}" for symbol in ("q", "w", "K", "D", "mu", "c", "I") for joint in (1, 2, 3)),
    *("payload", "late", "supply"),
    *(f"{symbol}{joint}" for symbol in ("torque", "bias", "drift") for joint in (1, 2, 3)),
)
"""rad, rad/s, N m/V, N m s/rad, N m, m, kg m^2; kg; samples, 1; N m, rad, rad/s"""
SIZE: Final = len(NAMES)
SCALE: Final = "scale"
"""Name of the state in the place of a joint's drift while its encoder's offset grows with the angle, 1."""
INDEX: Final = {
    **{name: index for index, name in enumerate(NAMES)},
    **{f"{SCALE}{joint}": NAMES.index(f"drift{joint}") for joint in (1, 2, 3)},
}
Q: Final = 0
W: Final = 3
ARM: Final = 6
"""the first of the 15 parameters of the arm"""
ARM_NAMES: Final = NAMES[6:21]
PAYLOAD: Final = 21
LATE: Final = 22
SUPPLY: Final = 23
TORQUE: Final = 24
MOVING: Final = 27
"""states before this one act on the motion, the others on what is measured of it"""
BIAS: Final = 27
DRIFT: Final = 30


def unit_jump(name: str, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """By how much the state x (33,) changes when one of its components, given by name, jumps by one unit, (33,).

    The offset of an encoder of another scale is proportional to the angle, from the jump on.
    """
    change = np.zeros(SIZE)
    change[INDEX[name]] = 1.0
    if name.startswith(SCALE):
        joint = INDEX[name] - DRIFT
        change[BIAS + joint] = x[joint]
    return change
