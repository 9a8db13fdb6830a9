"""Reads candidates for a what-if simulation: `T=1.5 kp=300,600,400 kd2=5 law=row_sum D2=0.1 payload=0.25`.

T                       target time, s
kp ki kd                gains of all joints (one number) or of each (three); kp1 ... kd3 for one joint
law                     control law: computed_torque, row_sum or cascade
box                     mass of a carried box that the controller assumes, kg
payload                 mass at the tip of the simulated arm, kg
noise                   noise of the simulated encoders, rad
K1 ... mu3              parameter of the simulated arm, SI units
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, Final

from dtwin.controller.settings import LAWS
from dtwin.errors import ParameterError, choices
from dtwin.parameters import PARAMETER_NAMES, Gains
from dtwin.simulation.whatif import MotionCase

_GAIN: Final = re.compile(r"(kp|ki|kd)([123]?)")
_NUMBERS: Final = ("T", "box", "payload", "noise")
KEYS: Final = ("T", "kp", "ki", "kd", "kp1 ... kd3", "law", "box", "payload", "noise", "K1 ... mu3")


def vary(case: MotionCase, text: str) -> MotionCase:
    """A case with the changes in a text, which are separated by blanks.

    Raises:
        ParameterError: a name is unknown, or a value is of the wrong kind or out of range.
    """
    for word in text.split():
        name, equals, value = word.partition("=")
        if not equals:
            raise ParameterError(f"candidate {text!r}: expected NAME=VALUE, got {word!r}")
        case = _changed(case, name, value)
    return case


def _changed(case: MotionCase, name: str, value: str) -> MotionCase:
    settings = case.settings
    if match := _GAIN.fullmatch(name):
        return replace(case, settings=replace(settings, gains=_gains(settings.gains, match[1], match[2], value)))
    if name == "law":
        if value not in LAWS:
            raise ParameterError(f"law: expected {choices(LAWS)}, got {value!r}")
        return replace(case, settings=replace(settings, law=value))
    if name in PARAMETER_NAMES:
        return replace(case, arm=case.arm.with_values({name: _number(name, value)}))
    if name not in _NUMBERS:
        raise ParameterError(f"candidate: unknown name {name!r}: expected {choices(KEYS)}")
    number = _number(name, value)
    if name == "T":
        return replace(case, settings=replace(settings, target_time=number))
    if name == "box":
        return replace(case, settings=replace(settings, payload=number))
    return replace(case, payload=number) if name == "payload" else replace(case, noise=number)


def _gains(gains: Gains, kind: str, joint: str, value: str) -> Gains:
    numbers = [_number(kind + joint, part) for part in value.split(",")]
    values: list[float] = list(getattr(gains, kind))
    if joint and len(numbers) == 1:
        values[int(joint) - 1] = numbers[0]
    elif not joint and len(numbers) in (1, 3):
        values = numbers * (3 // len(numbers))
    else:
        raise ParameterError(
            f"{kind}{joint}: expected {'one number' if joint else 'one number or three'}, got {value}"
        )
    changed: dict[str, Any] = {kind: tuple(values)}
    return replace(gains, **changed)


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ParameterError(f"{name}: expected a number, got {text!r}") from None
