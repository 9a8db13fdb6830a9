"""The range of every setting of a controller for an arm of this kind; what lies outside reaches no device."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Final

from dtwin.controller.settings import ControlSettings
from dtwin.errors import ParameterError
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, symbol_of

HIGHEST_GAINS: Final = {"kp": 1e5, "ki": 1e5, "kd": 1e3}
"""Greatest gains, 1/s^2, 1/s^3 and 1/s: a hundred times what is of use."""
MODEL_RANGES: Final = {
    "K": (1e-2, 1.0),
    "m": (1e-3, 1.0),
    "I": (1e-6, 0.1),
    "l": (1e-2, 0.5),
    "c": (0.0, 0.5),
    "D": (0.0, 5.0),
    "mu": (0.0, 5.0),
}
"""Least and greatest value of an arm of this kind, by the symbol of the parameter, SI units."""
PAYLOADS: Final = (0.0, 1.0)
"""Least and greatest mass of a box, kg: far more than the arm can lift."""
ENCODER_OFFSETS: Final = (-0.2, 0.2)
"""Least and greatest offset of an encoder that is taken off its readings, rad."""
TARGET_TIMES: Final = (0.1, 60.0)
"""Shortest and longest motion, s."""


def check_bounds(settings: ControlSettings) -> None:
    """Checks gains, target time, model, payload and offsets.

    Raises:
        ParameterError: a value is out of range; the message says which, and what the range is.
    """
    _check("target time", settings.target_time, *TARGET_TIMES, " s")
    for field in fields(settings.gains):
        values: Iterable[float] = getattr(settings.gains, field.name)
        for joint, value in enumerate(values, 1):
            _check(f"{field.name}{joint}", value, 0.0, HIGHEST_GAINS[field.name])
    check_model(settings.model)
    _check("payload", settings.payload, *PAYLOADS, " kg")
    for joint, offset in enumerate(settings.encoder_offset, 1):
        _check(f"offset of encoder {joint}", offset, *ENCODER_OFFSETS, " rad")


def check_model(arm: ArmParameters) -> None:
    """Checks the parameters of an arm.

    Raises:
        ParameterError: a value is none of an arm of this kind; the message says which, and what the range is.
    """
    for name, value in zip(PARAMETER_NAMES, arm.vector(), strict=True):
        _check(name, value, *MODEL_RANGES[symbol_of(name)])


def _check(name: str, value: float, low: float, high: float, unit: str = "") -> None:
    if not low <= value <= high:
        raise ParameterError(f"{name}: expected {low:g} to {high:g}{unit}, got {value:g}")
