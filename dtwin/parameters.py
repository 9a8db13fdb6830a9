"""Physical parameters, controller gains and the task's places: frozen, validated, in SI units.

Every consumer receives these explicitly; nothing reads a module-level arm. The values are those of the
arm's data sheet in docs/model.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import msgspec

from dtwin.errors import ModelError, ParameterError, choices

JOINTS: Final = 3
"""Number of joints of the cell's arm, as `arms/thesis.toml` has them."""
JointVector = tuple[float, ...]
"""One number for each joint of an arm, from the base outward."""
ONE_A_JOINT: Final = msgspec.Meta(min_length=JOINTS, max_length=JOINTS)
"""Says of a sequence that it has one entry for each joint of the cell's arm."""
CellJoints = Annotated[JointVector, ONE_A_JOINT]
"""One number for each joint of the cell's arm. Whoever reads it from a message, a file or the command line refuses
another length."""

Point = tuple[float, float, float]
"""Coordinates (x, y, z) of a point, m."""


def joint_vector(values: Iterable[float]) -> JointVector:
    """Numbers that stand one for each joint, such as a row of an array, as they are passed on."""
    return tuple(map(float, values))


def every_joint(value: float) -> JointVector:
    """The same number for every joint of the cell's arm."""
    return (value,) * JOINTS


PayloadModel = Literal["point", "weight"]
"""How a payload enters the equations: as a point mass at the tip, or by its weight alone."""
Law = Literal["computed_torque", "row_sum", "cascade"]
"""How the control law feeds back: through the mass matrix, through its row sums without the damping term, or from a
position error to a velocity and from its error to a torque."""

GRAVITY: Final = 9.81
"""Acceleration of gravity, m/s^2."""
VOLTAGE_LIMIT: Final = 8.0
"""Largest voltage of every motor, V."""
PERIOD: Final = 0.010
"""Period of controller and sensors, s."""
PHYSICS_STEP: Final = 0.0025
"""Integration step of the emulation, s."""
COULOMB_WIDTH: Final = 0.1
"""Velocity over which Coulomb friction mu tanh(q'/width) changes sign, rad/s; the same in emulation and twin."""
SOURCE: Final = Path(__file__).resolve().parent.parent
"""Folder that holds this package: a checkout, or where packages are installed."""
ROOT: Final = SOURCE if (SOURCE / "models" / "arm.xml").exists() else Path(__file__).resolve().parent / "data"
"""Folder that holds fb, models, config and machines: the checkout, or the package where it is installed."""

_SYMBOLS: Final = {
    "K": "voltage_constant",
    "m": "mass",
    "I": "inertia",
    "l": "length",
    "c": "com",
    "D": "damping",
    "mu": "coulomb",
}
_VECTORS: Final = attrgetter(*_SYMBOLS.values())
PARAMETER_NAMES: Final = tuple(f"{symbol}{joint}" for symbol in _SYMBOLS for joint in range(1, JOINTS + 1))
"""The names K1, K2, K3, m1, ..., D3, mu1, mu2, mu3, in the order of `ArmParameters.vector`."""


def symbol_of(name: str) -> str:
    """The symbol in one of PARAMETER_NAMES: `K` of `K2`, `mu` of `mu3`.

    Raises:
        ParameterError: there is no such parameter.
    """
    return tuple(_SYMBOLS)[_index(name) // JOINTS]


_UNITS: Final = {
    "K": "N m/V",
    "m": "kg",
    "I": "kg m^2",
    "l": "m",
    "c": "m",
    "D": "N m s/rad",
    "mu": "N m",
    "offset": "rad",
    "payload": "kg",
}


def unit_of(name: str) -> str:
    """The unit of one of PARAMETER_NAMES, of an encoder's offset or of a load; "" for another name."""
    return _UNITS.get(name.rstrip("0123456789"), "")


@dataclass(frozen=True, slots=True)
class ArmParameters:
    """Parameters of the three links, one value per link.

    Attributes:
        voltage_constant: motor torque per volt K, N m/V.
        mass: mass m, kg.
        inertia: moment of inertia I about the centre of mass, kg m^2.
        length: length l, m.
        com: distance c of the centre of mass from the joint, along the link, m.
        damping: viscous damping D, N m s/rad.
        coulomb: Coulomb friction mu, N m.

    Raises:
        ParameterError: a value is not finite, or negative, or a mass, inertia, length or K is zero.
    """

    voltage_constant: CellJoints = (0.01765 / 0.075, 0.0118 / 0.075, 0.0118 / 0.075)
    mass: CellJoints = (0.11804, 0.11604, 0.12993861)
    inertia: CellJoints = (5.3325e-4, 3.7766e-4, 2.4296e-4)
    length: CellJoints = (0.15786938, 0.13246938, 0.1608)
    com: CellJoints = (0.120, 0.100, 0.140)
    damping: CellJoints = every_joint(0.05)
    coulomb: CellJoints = every_joint(0.0)

    def __post_init__(self) -> None:
        for symbol, name in _SYMBOLS.items():
            values = getattr(self, name)
            if len(values) != JOINTS:
                raise ParameterError(f"{name}: expected {JOINTS} values, one a link, got {len(values)}")
            for joint, value in enumerate(values, 1):
                zero_allowed = symbol in ("D", "mu", "c")
                if not math.isfinite(value) or value < 0 or (value == 0 and not zero_allowed):
                    bound = "at least 0" if zero_allowed else "above 0"
                    raise ParameterError(f"{symbol}{joint} ({name}): expected a finite number {bound}, got {value}")

    def vector(self) -> tuple[float, ...]:
        """The 21 values in the order of PARAMETER_NAMES."""
        return tuple(chain.from_iterable(_VECTORS(self)))

    @classmethod
    def from_vector(cls, values: tuple[float, ...]) -> ArmParameters:
        """The arm with 21 values in the order of PARAMETER_NAMES: the inverse of `vector`.

        Raises:
            ParameterError: there are not 21 values, or one is out of range.
        """
        if len(values) != len(PARAMETER_NAMES):
            raise ParameterError(f"expected {len(PARAMETER_NAMES)} values, got {len(values)}")
        return cls(*(joint_vector(values[i : i + JOINTS]) for i in range(0, len(values), JOINTS)))

    def get(self, name: str) -> float:
        """The value of one parameter by its name, such as `K2`.

        Raises:
            ParameterError: there is no such parameter.
        """
        return self.vector()[_index(name)]

    def with_values(self, values: Mapping[str, float]) -> ArmParameters:
        """A copy in which the named values (`{"K2": 0.1}`) are replaced.

        Raises:
            ParameterError: there is no such parameter, or a value is out of range.
        """
        vector = list(self.vector())
        for name, value in values.items():
            vector[_index(name)] = float(value)
        return ArmParameters.from_vector(tuple(vector))


def _index(name: str) -> int:
    try:
        return PARAMETER_NAMES.index(name)
    except ValueError:
        raise ParameterError(f"unknown parameter {name!r}: expected {choices(PARAMETER_NAMES)}") from None


@dataclass(frozen=True, slots=True)
class GripperParameters:
    """Parameters of the gripper: one hinge between hard stops, decoupled from the arm.

    Attributes:
        inertia: moment of inertia about the hinge, kg m^2.
        voltage_constant: motor torque per volt, N m/V.
        damping: viscous damping, N m s/rad.
        closed: angle of the closed stop, rad.
        opened: angle of the open stop, rad.
        volts: voltage that opens the gripper, and with the opposite sign closes it, V.
    """

    inertia: float = 0.1
    voltage_constant: float = 0.0118 / 0.075
    damping: float = 0.05
    closed: float = 0.39265
    opened: float = 0.9
    volts: float = 3.0


@dataclass(frozen=True, slots=True)
class Gains:
    """Gains of a control law, one value per joint: kp in 1/s^2, ki in 1/s^3, kd in 1/s.

    What is usual depends on the law: `dtwin.controller.settings.usual_gains` gives it.

    Raises:
        ParameterError: a gain is negative or not finite, or there is not one for each joint.
    """

    kp: CellJoints
    ki: CellJoints
    kd: CellJoints

    def __post_init__(self) -> None:
        for field in fields(self):
            values = getattr(self, field.name)
            if len(values) != JOINTS:
                raise ParameterError(f"{field.name}: expected {JOINTS} values, one a joint, got {len(values)}")
            for joint, value in enumerate(values, 1):
                if not math.isfinite(value) or value < 0:
                    raise ParameterError(f"{field.name}{joint}: expected a finite number at least 0, got {value}")


@dataclass(frozen=True, slots=True)
class Place:
    """A place of the task: coordinates from joint 1 (m) and the joint angles that the planner moves to (rad)."""

    x: float
    y: float
    theta: CellJoints


Colour = str
"""Colour of a box, and name of the place it belongs to."""
PICKUP: Final = Place(0.2, -0.2, (-0.6699, -1.5931, 2.2630))
PLACES: Final[Mapping[Colour, Place]] = {
    "blue": Place(0.1, 0.0, (2.1855, -3.5259, 1.3404)),
    "red": Place(0.15, 0.15, (2.5298, -2.0654, -0.4644)),
    "green": Place(0.15, 0.28, (1.8515, -0.5320, -1.3195)),
}
HOME: Final[JointVector] = every_joint(0.0)
HANGING: Final[JointVector] = (-math.pi / 2, 0.0, 0.0)


def assignment(text: str) -> tuple[str, float]:
    """Reads `NAME=NUMBER`, such as `m1=0.15`; the name is checked where it is used.

    Raises:
        ParameterError: the text has another form.
    """
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise ParameterError(f"{text!r}: expected NAME=NUMBER, e.g. m1=0.15") from None


def load_arm(path: Path) -> ArmParameters:
    """Reads arm parameters from JSON: an object from parameter names (`K1` ... `mu3`) to numbers, all optional.

    Raises:
        ModelError: the file is missing or not such an object. ParameterError: a value is out of range.
    """
    try:
        values: Any = msgspec.json.decode(path.read_bytes(), type=dict[str, float])
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror}") from None
    except msgspec.MsgspecError as error:
        raise ModelError(f"{path}: expected a JSON object of parameter names and numbers: {error}") from None
    return ArmParameters().with_values(values)


def scaled(parameters: ArmParameters, symbol: str, factor: float) -> ArmParameters:
    """A copy in which the three values of one symbol (K, m, I, l, c, D, mu) are multiplied by a factor.

    Raises:
        ParameterError: there is no such symbol, or a value is out of range.
    """
    if symbol not in _SYMBOLS:
        raise ParameterError(f"unknown symbol {symbol!r}: expected {choices(_SYMBOLS)}")
    name = _SYMBOLS[symbol]
    values: dict[str, Any] = {name: tuple(factor * value for value in getattr(parameters, name))}
    return replace(parameters, **values)
