"""What a real arm has beside the equations of motion, as far as the twin can predict it.

docs/machine.md has the equations. Some effects of a real arm are not here because the twin has no state for them:
elasticity and play of gears, samples that are lost.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Final

from dtwin.errors import ParameterError, choices
from dtwin.parameters import CellJoints, JointVector, every_joint

_NONE: Final[JointVector] = every_joint(0.0)


@dataclass(frozen=True, slots=True)
class Effects:
    """Effects of drives, gears, structure and encoders; without arguments there are none.

    Attributes:
        rotor_inertia: inertia of the rotor as seen at the joint, kg m^2.
        lag: time constant of amplifier and windings, s.
        dead_zone: voltage that is lost in the amplifier, V.
        stiction: friction at rest beyond the Coulomb friction, N m.
        stribeck_velocity: velocity over which that fades, rad/s.
        cable: stiffness of the cables that span the joint, N m/rad.
        torque: torque of those cables at the angle 0, N m.
        com_offset: distance of the centre of mass from the link's line, to the left of it, m.
        eccentric_sin: error of the encoder that goes with the sine of the angle, rad.
        eccentric_cos: error of the encoder that goes with the cosine of the angle, rad.
        ripple_sin: torque of the motor that goes with the sine of ripple_periods times the angle, N m.
        ripple_cos: torque that goes with the cosine of that, N m.
        ripple_periods: periods of that torque in a turn.
        tilt: angle by which the base is turned in the arm's plane, rad.
        delay: time from a command until the encoders show that it acts, as far as it is a delay, s.
        sag: resistance of the supply, as a share of that of one winding.

    Raises:
        ParameterError: a value is not finite or out of range.
    """

    rotor_inertia: CellJoints = _NONE
    lag: CellJoints = _NONE
    dead_zone: CellJoints = _NONE
    stiction: CellJoints = _NONE
    stribeck_velocity: CellJoints = every_joint(0.1)
    cable: CellJoints = _NONE
    torque: CellJoints = _NONE
    com_offset: CellJoints = _NONE
    eccentric_sin: CellJoints = _NONE
    eccentric_cos: CellJoints = _NONE
    ripple_sin: CellJoints = _NONE
    ripple_cos: CellJoints = _NONE
    ripple_periods: CellJoints = every_joint(20.0)
    tilt: float = 0.0
    delay: float = 0.0
    sag: float = 0.0

    def __post_init__(self) -> None:
        for name, value in self.values().items():
            least = 1e-3 if name.startswith("stribeck") else -math.inf if name.startswith(SIGNED) else 0.0
            if not (math.isfinite(value) and value >= least):
                bound = "" if math.isinf(least) else f" of at least {least:g}"
                raise ParameterError(f"{name}: expected a finite number{bound}, got {value}")

    def values(self) -> dict[str, float]:
        """All values by the names of EFFECT_NAMES."""
        found: dict[str, float] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, tuple):
                found |= {f"{field.name}{joint}": number for joint, number in enumerate(value, 1)}
            else:
                found[field.name] = value
        return found

    def with_values(self, values: Mapping[str, float]) -> Effects:
        """A copy in which the named values (`{"lag2": 0.004}`) are replaced.

        Raises:
            ParameterError: there is no such effect, or a value is out of range.
        """
        if strangers := [name for name in values if name not in EFFECT_NAMES]:
            raise ParameterError(f"unknown effect {strangers[0]!r}: expected {choices(EFFECT_NAMES)}")
        merged = {**self.values(), **{name: float(value) for name, value in values.items()}}
        changed: dict[str, Any] = {
            name: (merged[f"{name}1"], merged[f"{name}2"], merged[f"{name}3"]) if name in _OF_JOINTS else merged[name]
            for name in _FIELDS
        }
        return Effects(**changed)


_FIELDS: Final = tuple(field.name for field in fields(Effects))
_OF_JOINTS: Final = tuple(field.name for field in fields(Effects) if isinstance(field.default, tuple))
SIGNED: Final = ("torque", "com_offset", "eccentric", "ripple_sin", "ripple_cos", "tilt")
"""How the names begin of the effects that may be below 0."""
EFFECT_NAMES: Final = tuple(
    name for field in _FIELDS for name in ([f"{field}{j}" for j in (1, 2, 3)] if field in _OF_JOINTS else [field])
)
"""The names rotor_inertia1, rotor_inertia2, ..., tilt, delay, sag, in the order of `Effects.values`."""
NO_EFFECTS: Final = Effects()
