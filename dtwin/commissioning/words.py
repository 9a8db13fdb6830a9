"""Words and units for the numbers of a machine."""

from __future__ import annotations

import math
from typing import Final

from dtwin.identification.machine.record import USUAL_BOX, Grade, Number

NINETY_FIVE: Final = 1.959964
"""Standard deviations of a normal distribution within which 95 % lie."""
GRADES: Final[dict[Grade, str]] = {
    "identified": "Identified: the model predicts motion that it has not seen. Monitor and settings may rest on it.",
    "approximate": "Approximate: the model predicts motion that it has not seen roughly. The monitor may rest on it"
    " with the larger threshold that it has learned; judge the settings by a trial.",
    "unusable": "Unusable: the model does not predict motion that it has not seen. Nothing should rest on it.",
}
_QUANTITIES: Final = {
    "K": ("torque of motor {} per volt", "N m/V"),
    "m": ("mass of link {}", "kg"),
    "I": ("inertia of link {}", "kg m²"),
    "l": ("length of link {}", "m"),
    "c": ("centre of mass of link {}", "m"),
    "D": ("damping of joint {}", "N m s/rad"),
    "mu": ("Coulomb friction of joint {}", "N m"),
    "rotor_inertia": ("rotor inertia at joint {}", "kg m²"),
    "lag": ("lag of drive {}", "s"),
    "dead_zone": ("dead zone of drive {}", "V"),
    "stiction": ("stiction of joint {}", "N m"),
    "stribeck_velocity": ("Stribeck velocity of joint {}", "rad/s"),
    "cable": ("stiffness of the cables at joint {}", "N m/rad"),
    "torque": ("torque of the cables at joint {}", "N m"),
    "com_offset": ("offset of the centre of mass of link {}", "m"),
    "eccentric_sin": ("eccentricity of encoder {}, sine", "rad"),
    "eccentric_cos": ("eccentricity of encoder {}, cosine", "rad"),
    "ripple_sin": ("ripple of motor {}, sine", "N m"),
    "ripple_cos": ("ripple of motor {}, cosine", "N m"),
    "ripple_periods": ("ripple of motor {}, periods a turn", ""),
    "tilt": ("tilt of the base", "rad"),
    "delay": ("delay of drives and encoders", "s"),
    "sag": ("resistance of the supply, share of a winding's", ""),
}


def quantity(name: str) -> tuple[str, str]:
    """What one of the numbers of a machine is, in words, and its unit."""
    words, unit = _QUANTITIES[name.rstrip("123")]
    return words.format(name[-1]), unit


def interval(number: Number) -> str:
    """The value of a number with its 95 % interval."""
    return f"{number.value:.4g} ± {NINETY_FIVE * number.deviation:.2g}"


def steps(step: float | None) -> str:
    """The resolution of an encoder in words."""
    if step is None:
        return "none seen"
    turn = math.tau / step
    bits = math.log2(turn)
    whole = f", {bits:.0f} bits" if abs(bits - round(bits)) < 1e-4 else ""
    return f"{1e3 * step:.4g} mrad ({turn:.6g} steps a turn{whole})"


def load(scale: float) -> str:
    """What a box is on the numbers of a machine, in words, by the mass with which it moves, as a share of its own."""
    usual = 1e3 * USUAL_BOX
    return f"a box of {usual:.0f} g moves on these numbers like one of {scale * usual:.0f} g"
