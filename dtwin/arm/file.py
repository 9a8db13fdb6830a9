"""Arms as files: `arms/NAME.toml` beside its model, or any other TOML file of the same form (docs/arms.md).

model = "six-axis.xml"     # MJCF or URDF, beside this file
tip = "wrist_3"            # last body or link of the chain; the end of the longest chain without it

[joints.shoulder]
commanded = "A"            # what its drive takes: V, A, N m, or N where it slides
constant = 0.11            # N m of the motor a unit of the command
gear = 101.0
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal, cast, get_args

import msgspec
import numpy as np

from dtwin.arm.chain import Actuator, Arm, Brake, Commanded, Friction, Gripper, Joint, Side, Tolerances, Transmission
from dtwin.errors import ModelError, choices
from dtwin.files import reason_of
from dtwin.parameters import ROOT, Point

FOLDER: Final = ROOT / "arms"
"""Folder of the named arms."""
SUFFIX: Final = ".toml"
UNITS: Final[dict[str, Commanded]] = {
    "N m": "torque",
    "N": "torque",
    "A": "current",
    "V": "voltage",
    "rad": "position",
    "m": "position",
}
"""What an actuator can be commanded in."""
_LARGEST: Final = 1 << 18
"""Largest file that is read, bytes."""
ENGAGES: Final = 0.05
"""Time from the command of a brake until it holds where a file does not say it, s."""
SIDES: Final[tuple[Side, ...]] = get_args(Side)
"""Sides of a gear on which an encoder can be."""
Sign = Literal["any", "positive", "not negative"]

_JOINT: Final[dict[str, tuple[Sign, str]]] = {
    "constant": ("any", "torque of the motor a unit of the command, N m"),
    "limit": ("positive", "largest command either way, in its unit"),
    "stiffness": (
        "positive",
        "of a drive commanded in rad or m: torque at the joint a unit off the command, N m/rad",
    ),
    "damping": ("not negative", "of such a drive: torque at the joint against its velocity, N m s/rad"),
    "gear": ("any", "turns of the motor for one of the joint"),
    "rotor": ("not negative", "inertia of the rotor at the motor, kg m^2"),
    "viscous": ("not negative", "viscous friction at the joint, N m s/rad"),
    "coulomb": ("not negative", "Coulomb friction at the joint, N m"),
    "load": ("not negative", "friction that grows with the load, in parts of the torque carried"),
    "gear_stiffness": ("positive", "stiffness of the gear as seen at the joint, N m/rad or N/m"),
    "gear_damping": ("not negative", "its damping, N m s/rad or N s/m"),
    "backlash": ("not negative", "its whole play at the joint, rad or m"),
    "brake": ("positive", "torque that its holding brake holds, at the joint, N m or N"),
    "brake_delay": ("not negative", "time from the command of that brake until it holds, s"),
    "encoder": ("not negative", "step of the encoder at the joint, rad or m"),
    "lower": ("any", "least position, rad or m"),
    "upper": ("any", "largest position, rad or m"),
    "speed": ("positive", "largest speed, rad/s or m/s"),
    "acceleration": ("positive", "largest acceleration of a path, rad/s^2 or m/s^2"),
    "effort": ("positive", "largest torque or force at the joint, N m or N"),
}
"""Numbers of a joint, with what each means."""
_TOLERANCES: Final[dict[str, tuple[Sign, str]]] = {
    "constant": ("not negative", "relative standard deviation of the constants"),
    "mass": ("not negative", "relative standard deviation of the masses"),
    "inertia": ("not negative", "relative standard deviation of the inertias"),
    "friction": ("not negative", "relative standard deviation of every friction"),
    "gear": ("not negative", "relative standard deviation of stiffness, damping and play of the gears"),
    "centre": ("not negative", "standard deviation of the centres of mass, m"),
    "noise": ("not negative", "standard deviation of the encoders' noise, rad or m"),
}
_WORDS: Final[dict[str, Iterable[str]]] = {"commanded": UNITS, "encoder_at": SIDES}
"""What else is said of a joint, with the words for it."""
NEEDED: Final = ("commanded", "constant", "limit")
"""What a person must say of a joint before the arm can be driven."""
_TOP: Final = ("model", "tip", "period", "tool", "joints", "tolerances", "gripper")


@dataclass(frozen=True, slots=True)
class ArmFile:
    """What a file says of an arm.

    Attributes:
        path: the file.
        model: its model file.
        tip: last body or link of the chain; None for the end of the longest chain.
        period: time between two samples, s.
        tool: point of the last link that does the work, m; None for the model's.
        joints: what it says of joints, by their names: numbers, and the unit of the command.
        tolerances: how arms of this kind differ from it.
        payload: largest mass that the gripper holds, kg; None without a gripper.
    """

    path: Path
    model: Path
    tip: str | None = None
    period: float = 0.01
    tool: Point | None = None
    joints: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)
    tolerances: Tolerances = field(default_factory=Tolerances)
    payload: float | None = None


def names() -> list[str]:
    """Names of the arms in `arms/`."""
    return sorted(path.stem for path in FOLDER.glob(f"*{SUFFIX}"))


def path_of(text: str) -> Path:
    """The file that a name or a path stands for: an arm's (*.toml), or a model alone (*.xml, *.urdf).

    Raises:
        ModelError: there is no such arm.
    """
    path = Path(text)
    if path.suffix.lower() in (SUFFIX, *MODELS):
        return path
    if text not in names():
        raise ModelError(f"arm {text!r}: expected a file (*.toml, *.urdf, *.xml), or {choices(names())}")
    return FOLDER / f"{text}{SUFFIX}"


def file_of(text: str) -> ArmFile:
    """What the file says that a name or a path stands for; a model alone says nothing beside itself.

    Raises:
        ModelError: there is no such arm, or the file cannot be read.
    """
    path = path_of(text)
    return read_file(path) if path.suffix.lower() == SUFFIX else ArmFile(path, path)


MODELS: Final = (".xml", ".urdf", ".mjcf")
"""Endings of the names of model files."""


def read_file(path: Path) -> ArmFile:
    """Reads the file of an arm; its model is not looked at.

    Raises:
        ModelError: the file cannot be read, or holds what no arm has; names file and key, and what was expected.
    """
    content = content_of(path, "an arm")
    try:
        return _file(path, content)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None


def content_of(path: Path, what: str) -> dict[str, Any]:
    """What a TOML file says that shall be `what`.

    Raises:
        ModelError: it cannot be read.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise ModelError(f"{path}: expected at most {_LARGEST} bytes, got {path.stat().st_size}")
        return cast(dict[str, Any], msgspec.toml.decode(path.read_bytes()))
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {reason_of(error)}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise ModelError(f"{path}: expected {what}: {error}") from None


def _file(path: Path, content: dict[str, Any]) -> ArmFile:
    _known("", content, _TOP)
    model = _text("model", content.get("model"))
    tip = _text("tip", content["tip"]) if "tip" in content else None
    joints = joints_of(content)
    spread = _table("tolerances", content.get("tolerances", {}))
    _known("tolerances", spread, _TOLERANCES)
    numbers = {key: _number(f"tolerances.{key}", value, *_TOLERANCES[key]) for key, value in spread.items()}
    held = _table("gripper", content.get("gripper", {}))
    _known("gripper", held, ("payload",))
    payload = _number("gripper.payload", held.get("payload"), "positive", "mass, kg") if held else None
    period = _number("period", content.get("period", 0.01), "positive", "time between two samples, s")
    if period > 0.1:
        raise ModelError(f"period: expected at most 0.1 s, got {period:g}")
    tool = _point("tool", content["tool"]) if "tool" in content else None
    return ArmFile(path, path.parent / model, tip, period, tool, joints, Tolerances(**numbers), payload)


def joints_of(content: Mapping[str, Any]) -> dict[str, dict[str, float | str]]:
    """What the table `joints` of a file says of joints, by their names.

    Raises:
        ModelError: it holds what no joint has.
    """
    return {
        name: _joint(f"joints.{name}", _table(f"joints.{name}", values))
        for name, values in _table("joints", content.get("joints", {})).items()
    }


def complete(file: ArmFile, chain: Arm) -> Arm:
    """The arm: the chain of its model with what its file says.

    Raises:
        ModelError: the file names a joint that the chain has not, or a range is empty.
    """
    made = with_joints(replace(chain, tolerances=file.tolerances), file.path, file.joints)
    return replace(
        made,
        name=file.path.stem,
        tool=chain.tool if file.tool is None else np.array(file.tool),
        period=file.period,
        gripper=None if file.payload is None else Gripper(file.payload),
    )


def with_joints(arm: Arm, path: Path, said: Mapping[str, Mapping[str, float | str]]) -> Arm:
    """An arm with what a file says of its joints, by their names.

    Raises:
        ModelError: the file names a joint that the arm has not, a range is empty, or something of a gear is missing.
    """
    have = [joint.name for joint in arm.joints]
    for name in said:
        if name not in have:
            raise ModelError(f"{path}: joints.{name}: expected a joint of the model, {choices(have)}")
    deviation = arm.tolerances.constant
    try:
        joints = tuple(_completed(joint, said.get(joint.name, {}), deviation) for joint in arm.joints)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    return replace(arm, joints=joints)


def missing(arm: Arm) -> list[str]:
    """What a person must still say before the arm can be driven, as keys of its file."""
    found = []
    for joint in arm.joints:
        actuator = joint.actuator
        own = {"constant": actuator.constant is not None, "limit": math.isfinite(actuator.limit)}
        if actuator.commanded == "position":
            own = {"stiffness": actuator.stiffness is not None, "effort": math.isfinite(joint.effort)}
        known = {
            **own,
            "lower": math.isfinite(joint.lower) or joint.turns,
            "speed": math.isfinite(joint.speed),
            "acceleration": math.isfinite(joint.acceleration),
        }
        found += [f"joints.{joint.name}.{key}" for key, there in known.items() if not there]
    return found


def meaning(key: str) -> str:
    """What the last part of a key of a joint means, for people."""
    name = key.rpartition(".")[2]
    return f"one of {choices(_WORDS[name])}" if name in _WORDS else _JOINT[name][1]


def _completed(joint: Joint, said: Mapping[str, float | str], deviation: float) -> Joint:
    numbers = cast(dict[str, float], {key: value for key, value in said.items() if key not in _WORDS})
    actuator, friction = joint.actuator, joint.friction
    gear = numbers.get("gear", actuator.gear)
    constant = numbers["constant"] * gear if "constant" in numbers else actuator.constant
    rotor = numbers["rotor"] * gear**2 if "rotor" in numbers else actuator.rotor
    commanded = UNITS[cast(str, said["commanded"])] if "commanded" in said else actuator.commanded
    if commanded == "torque" and constant is None:
        constant = 1.0
    limit = numbers.get("limit", actuator.limit)
    stiffness, damping = numbers.get("stiffness", actuator.stiffness), numbers.get("damping", actuator.damping)
    if commanded == "position":
        constant, limit = None, math.inf
    found = replace(
        joint,
        lower=numbers.get("lower", joint.lower),
        upper=numbers.get("upper", joint.upper),
        speed=numbers.get("speed", joint.speed),
        effort=numbers.get("effort", joint.effort),
        acceleration=numbers.get("acceleration", joint.acceleration),
        step=numbers.get("encoder", joint.step),
        actuator=Actuator(commanded, constant, deviation, gear, rotor, limit, stiffness, damping),
        friction=Friction(*(numbers.get(key, getattr(friction, key)) for key in ("viscous", "coulomb", "load"))),
        transmission=_transmission(joint, said, rotor),
        brake=_brake(joint, numbers),
    )
    if not found.lower < found.upper:
        raise ModelError(f"joints.{joint.name}: expected lower below upper, got {found.lower:g} and {found.upper:g}")
    return found


def _brake(joint: Joint, numbers: Mapping[str, float]) -> Brake | None:
    found = joint.brake
    if "brake" not in numbers and "brake_delay" in numbers and found is None:
        raise ModelError(f"joints.{joint.name}.brake_delay: expected brake: {meaning('brake')}")
    given = {
        name: numbers[key] for key, name in {"brake": "torque", "brake_delay": "delay"}.items() if key in numbers
    }
    return replace(found or Brake(0.0, ENGAGES), **given) if given else found


def _transmission(joint: Joint, said: Mapping[str, float | str], rotor: float | None) -> Transmission | None:
    keys = {"gear_stiffness": "stiffness", "gear_damping": "damping", "backlash": "backlash", "encoder_at": "encoder"}
    given = {name: said[key] for key, name in keys.items() if key in said}
    found = joint.transmission
    if not given:
        return found
    if found is None and "stiffness" not in given:
        first = next(key for key in keys if key in said)
        raise ModelError(f"joints.{joint.name}.{first}: expected gear_stiffness: {meaning('gear_stiffness')}")
    if not rotor:
        raise ModelError(f"joints.{joint.name}.gear_stiffness: expected rotor, above 0: {meaning('rotor')}")
    return replace(found or Transmission(0.0), **cast(dict[str, Any], given))


def _joint(where: str, values: dict[str, Any]) -> dict[str, float | str]:
    _known(where, values, (*_WORDS, *_JOINT))
    found: dict[str, float | str] = {}
    for key, value in values.items():
        if key in _WORDS:
            if value not in _WORDS[key]:
                raise ModelError(f"{where}.{key}: expected {choices(_WORDS[key])}, got {value!r}")
            found[key] = value
        else:
            found[key] = _number(f"{where}.{key}", value, *_JOINT[key])
            if key in ("constant", "gear") and not found[key]:
                raise ModelError(f"{where}.{key}: expected a number other than 0")
    return found


def _known(where: str, values: Mapping[str, Any], valid: Any) -> None:
    for key in values:
        if key not in valid:
            raise ModelError(f"{where + '.' if where else ''}{key}: unknown key: expected {choices(valid)}")


def _table(where: str, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ModelError(f"{where}: expected a table, got {value!r}")
    return value


def _text(where: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise ModelError(f"{where}: expected a text, got {'nothing' if value is None else repr(value)}")
    return value


def _number(where: str, value: Any, sign: Sign, what: str) -> float:
    good = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not good or (sign == "positive" and not value > 0.0) or (sign == "not negative" and value < 0.0):
        kind = {"any": "a number", "positive": "a number above 0", "not negative": "a number of at least 0"}[sign]
        raise ModelError(f"{where}: expected {kind} ({what}), got {value!r}")
    return float(value)


def _point(where: str, value: Any) -> Point:
    if not isinstance(value, list) or len(value) != 3:
        raise ModelError(f"{where}: expected three numbers, m, got {value!r}")
    x, y, z = (_number(where, number, "any", "m") for number in value)
    return x, y, z
