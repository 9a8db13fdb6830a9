"""The data sheet of the arm with its tolerances, as prior knowledge of everything that can be identified.

docs/machine.md has the same ranges with their sources. A value is expected in the middle of its range. Its standard
deviation is that of a uniform distribution over the range, 1.5 times: a data sheet is no promise.
"""

from __future__ import annotations

import math
from typing import Final

from dtwin.identification.estimation.problem import Prior
from dtwin.parameters import PARAMETER_NAMES, VOLTAGE_LIMIT, ArmParameters, symbol_of
from dtwin.twin.effects import EFFECT_NAMES

_RELATIVE: Final = {
    "K": (0.85, 1.05),
    "m": (0.95, 1.05),
    "I": (0.9, 1.1),
    "l": (0.9985, 1.0015),
    "c": (0.97, 1.03),
}
"""Ranges of the parameters as shares of the nominal value."""
_DAMPING: Final = (0.7, 1.4)
_BACK_EMF: Final = (0.03, 0.12)
"""Range of the back-EMF, V s/rad, which acts like a damping of K times that."""
_COULOMB: Final = (0.0, 0.03)
_EFFECTS: Final = {
    "rotor_inertia": (0.0006, 0.0015),
    "lag": (0.0025, 0.006),
    "dead_zone": (0.0, 0.25),
    "stiction": (0.0, 0.015),
    "stribeck_velocity": (0.05, 0.3),
    "cable": (0.0, 0.01),
    "torque": (-0.005, 0.005),
    "com_offset": (-0.002, 0.002),
    "eccentric_sin": (-0.002, 0.002),
    "eccentric_cos": (-0.002, 0.002),
    "tilt": (-0.01, 0.01),
    "delay": (0.0, 0.0125),
    "sag": (0.0, 0.05),
}
"""Ranges of the effects in their units; that of the delay is drive and encoders together."""
_RIPPLE: Final = 0.005
"""Largest ripple as a share of the torque of a motor that stands still under its largest voltage."""
RIPPLE_PERIODS: Final = (6.0, 40.0)
"""Range of the ripple's periods in a turn."""
_DOUBT: Final = 1.5

IDENTIFIED: Final = (
    *(name for name in PARAMETER_NAMES if symbol_of(name) != "l"),
    *(name for name in EFFECT_NAMES if not name.startswith(("stribeck_velocity", "ripple"))),
)
"""Names of what is identified of every machine.

Ripple is identified of the motors that show it (see `ripple`). The lengths keep the values of the data sheet because
it tells them well, the Stribeck velocities because motions of ordinary work hardly tell them from stiction.
"""


def sheet(arm: ArmParameters) -> dict[str, Prior]:
    """Expectation and standard deviation of every parameter and effect by name.

    Args:
        arm: arm as it was designed.
    """
    priors = {name: _parameter(name, arm) for name in PARAMETER_NAMES}
    return priors | {name: _effect(name, arm) for name in EFFECT_NAMES}


def _effect(name: str, arm: ArmParameters) -> Prior:
    kind = name.rstrip("123")
    if kind == "ripple_periods":
        return _within(*RIPPLE_PERIODS)
    if kind in ("ripple_sin", "ripple_cos"):
        most = _RIPPLE * VOLTAGE_LIMIT * arm.get(f"K{name[-1]}")
        return _within(-most, most)
    return _within(*_EFFECTS[kind])


def _parameter(name: str, arm: ArmParameters) -> Prior:
    symbol, value = symbol_of(name), arm.get(name)
    if symbol == "mu":
        return _within(*_COULOMB)
    if symbol == "D":
        constant = arm.get(f"K{name[-1]}")
        return _within(_DAMPING[0] * value + _BACK_EMF[0] * constant, _DAMPING[1] * value + _BACK_EMF[1] * constant)
    low, high = _RELATIVE[symbol]
    return _within(low * value, high * value)


def _within(low: float, high: float) -> Prior:
    return Prior((low + high) / 2.0, _DOUBT * (high - low) / math.sqrt(12.0))
