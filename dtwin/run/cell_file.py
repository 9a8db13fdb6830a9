"""Cells as files: `cells/*.toml`, or any other TOML file of the same form; docs/cells.md explains every key.

What a file leaves out is as in `cells/default.toml`, whose cell is that of a run without a file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final, Literal, TypeVar, cast

import msgspec

from dtwin.controller.settings import APPLICATION_LAW, USUAL_GAINS
from dtwin.emulation.encoders import NoiseKind, check_noise
from dtwin.emulation.faults import Fault, parse_fault
from dtwin.emulation.machine.files import is_file as is_machine_file
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import DtwinError, ModelError, ParameterError, choices
from dtwin.parameters import (
    GRAVITY,
    HANGING,
    ROOT,
    VOLTAGE_LIMIT,
    ArmParameters,
    CellJoints,
    Gains,
    JointVector,
    Law,
    Place,
)
from dtwin.task import DEFAULT_TASK, GREY, PICKUP_NAME, RGB, BoxStream, Destination, Task
from dtwin.twin.kinematics import forward, joint_positions, nearest

FOLDER: Final = ROOT / "cells"
"""Folder of the named cells."""
DEFAULT_NAME: Final = "default"
_SUFFIX: Final = ".toml"
_LONGEST: Final = 1 << 16
"""Largest file that is read, bytes."""
_NEAR: Final = 1e-3
"""Distance within which the angles of a place must lead to its coordinates, m."""
_LEVEL: Final = 0.01
"""Largest angle of link 3 to x at a place, rad."""
_FARTHEST: Final = 12.566
"""Largest angle of a joint at a place, rad: the block PATH_PLANNER takes no farther goal."""
T = TypeVar("T", bound=msgspec.Struct)


@dataclass(frozen=True, slots=True)
class CellFile:
    """What a file says of a cell.

    Attributes:
        task: where boxes wait, where those of each colour belong, and how they come.
        machine: the machine that the arm is: a name, a number or a file.
        arm: parameters of the arm that differ from the data sheet, by their names, SI units.
        faults: changes that happen at their times.
        noise: magnitude of the encoder noise, rad.
        noise_kind: "uniform", "gaussian" or "none".
        law: control law.
        gains: gains of the law.
        target_time: duration of every motion, s.
        payload: mass of a box that the controller assumes, kg.
    """

    task: Task = DEFAULT_TASK
    machine: str = IDEAL.name
    arm: tuple[tuple[str, float], ...] = ()
    faults: tuple[Fault, ...] = ()
    noise: float = 0.0
    noise_kind: NoiseKind = "uniform"
    law: Law = APPLICATION_LAW
    gains: Gains | None = None
    target_time: float = 2.0
    payload: float = DEFAULT_TASK.boxes.middle


class _Spot(msgspec.Struct, forbid_unknown_fields=True):
    x: float
    y: float
    theta: CellJoints | None = None
    elbow: Literal["up", "down"] | None = None


class _Stand(_Spot, forbid_unknown_fields=True):
    rgb: str | None = None


class _Boxes(msgspec.Struct, forbid_unknown_fields=True):
    size: float = BoxStream().size
    mass: tuple[float, float] = (BoxStream().lightest, BoxStream().heaviest)
    first: float = BoxStream().first
    every: float = BoxStream().every


class _Control(msgspec.Struct, forbid_unknown_fields=True):
    law: Law = APPLICATION_LAW
    target_time: float = 2.0
    kp: CellJoints | None = None
    ki: CellJoints | None = None
    kd: CellJoints | None = None
    payload: float | None = None


class _Noise(msgspec.Struct, forbid_unknown_fields=True):
    magnitude: float = 0.0
    kind: NoiseKind = "uniform"


_SECTIONS: Final = ("arm", "pickup", "places", "boxes", "control", "noise")
_KEYS: Final = ("machine", "faults", *_SECTIONS)


def names() -> list[str]:
    """Names of the cells in `cells/`."""
    return sorted(path.stem for path in FOLDER.glob(f"*{_SUFFIX}"))


def is_file(text: str) -> bool:
    """Whether a text stands for the file of a cell, not for a name."""
    return text.endswith(_SUFFIX)


def cell_of(text: str) -> CellFile:
    """The cell that a name or a file (*.toml) stands for.

    Raises:
        ModelError: there is no such cell, or its file cannot be read or holds what no cell has.
        ParameterError: a value is out of range, or the arm cannot reach a place, or not hold a box there.
    """
    return load(_path(text))


def text_of(text: str) -> str:
    """The text of the file of a cell, by its name or path.

    Raises:
        ModelError: there is no such cell, or its file cannot be read.
    """
    path = _path(text)
    try:
        return _content(path).decode()
    except UnicodeDecodeError as error:
        raise ModelError(f"{path}: expected a cell: {error}") from None


def task_named(text: str | None) -> Task | None:
    """The task of the cell that a name or a file stands for; None for None.

    Raises:
        DtwinError: as of `cell_of`.
    """
    return None if text is None else cell_of(text).task


def load(path: Path) -> CellFile:
    """Reads a cell.

    Raises:
        ModelError: the file cannot be read, or holds what no cell has; names the file and the key.
        ParameterError: a value is out of range, or the arm cannot reach a place, or not hold a box there.
    """
    content = _decoded(path)
    try:
        return _cell(content, path.parent)
    except DtwinError as error:
        kind = ModelError if isinstance(error, ModelError) else ParameterError
        raise kind(f"{path}: {error}") from None


def content_of(text: str) -> tuple[Path, dict[str, Any]]:
    """The file that a name or a path stands for, and what is in it, whatever cell it is.

    Raises:
        ModelError: there is no such cell, or its file cannot be read.
    """
    path = _path(text)
    return path, _decoded(path)


def _decoded(path: Path) -> dict[str, Any]:
    try:
        return cast(dict[str, Any], msgspec.toml.decode(_content(path)))
    except (msgspec.MsgspecError, ValueError) as error:
        raise ModelError(f"{path}: expected a cell: {error}") from None


def _path(text: str) -> Path:
    """The file that a name or a path stands for."""
    if is_file(text):
        return Path(text)
    if text not in names():
        raise ModelError(f"cell file {text!r}: expected a file (*{_SUFFIX}) or {choices(names())}")
    return FOLDER / f"{text}{_SUFFIX}"


def _content(path: Path) -> bytes:
    """What a file holds, as long as it can be a cell."""
    try:
        with path.open("rb") as file:
            content = file.read(_LONGEST + 1)
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror}") from None
    if len(content) > _LONGEST:
        raise ModelError(f"{path}: expected a cell of at most {_LONGEST} bytes")
    return content


def _cell(content: dict[str, Any], folder: Path) -> CellFile:
    if isinstance(content.get("arm"), str):
        raise ModelError(
            f"arm: {content['arm']!r} is another arm than the thesis's, which this does not know yet: expected "
            "`dtwin run --cell-file`, or `dtwin run`, `fb make`, `margins`, `arm excite` and `identify` with the arm"
        )
    _check_keys("", content, _KEYS)
    for section in _SECTIONS:
        if not isinstance(content.get(section, {}), dict):
            raise ModelError(f"{section}: expected a section, got {content[section]!r}")
    boxes = _boxes(_read("boxes", content.get("boxes", {}), _Boxes))
    control = _read("control", content.get("control", {}), _Control)
    noise = _read("noise", content.get("noise", {}), _Noise)
    check_noise(noise.kind, noise.magnitude)
    arm = {name: _convert(f"arm.{name}", value, float) for name, value in content.get("arm", {}).items()}
    ArmParameters().with_values(arm)
    return CellFile(
        _task(content, boxes),
        _machine(content.get("machine", IDEAL.name), folder),
        tuple(arm.items()),
        tuple(map(parse_fault, _convert("faults", content.get("faults", []), list[str]))),
        noise.magnitude,
        noise.kind,
        control.law,
        _gains(control),
        control.target_time,
        boxes.middle if control.payload is None else control.payload,
    )


def _task(content: dict[str, Any], boxes: BoxStream) -> Task:
    pickup, destinations = DEFAULT_TASK.pickup, DEFAULT_TASK.destinations
    if "pickup" in content:
        pickup = _place(PICKUP_NAME, _read(PICKUP_NAME, content["pickup"], _Spot), HANGING, boxes)
    if "places" in content:
        stands = {name: _read(f"places.{name}", value, _Stand) for name, value in content["places"].items()}
        destinations = tuple(
            Destination(name, _place(f"places.{name}", stand, pickup.theta, boxes), _rgb(name, stand.rgb))
            for name, stand in stands.items()
        )
    return Task(pickup, destinations, boxes)


def _boxes(given: _Boxes) -> BoxStream:
    return BoxStream(given.size, *given.mass, given.first, given.every)


def _gains(control: _Control) -> Gains | None:
    given = {name: getattr(control, name) for name in (field.name for field in fields(Gains))}
    if all(value is None for value in given.values()):
        return None
    usual = USUAL_GAINS[control.law]
    return Gains(**{name: getattr(usual, name) if value is None else value for name, value in given.items()})


def _machine(text: Any, folder: Path) -> str:
    if isinstance(text, bool) or not isinstance(text, str | int):
        raise ModelError(f"machine: expected a name, a file or a number, got {text!r}")
    name = str(text)
    return str((folder / name).resolve()) if is_machine_file(name) else name


def _place(where: str, spot: _Spot, near: JointVector, boxes: BoxStream) -> Place:
    """The place with its angles, checked to be reached by an arm that can hold the heaviest box there.

    Args:
        where: key of the place.
        spot: what the file says.
        near: angles that the arm comes from, rad.
        boxes: the boxes of the cell.
    """
    arm = ArmParameters()
    if spot.theta is not None and spot.elbow is not None:
        raise ModelError(f"{where}: expected theta or elbow, got both")
    try:
        theta = spot.theta or nearest(spot.x, spot.y, arm, near, spot.elbow)
    except DtwinError as error:
        raise ParameterError(f"{where}: the arm does not reach the place: {error}") from None
    if not all(abs(angle) <= _FARTHEST for angle in theta):
        raise ParameterError(f"{where}.theta: expected angles of at most {_FARTHEST} rad either way, got {theta}")
    x, y, phi = forward(theta, arm)
    away = math.hypot(x - spot.x, y - spot.y)
    if not away <= _NEAR:
        raise ParameterError(
            f"{where}.theta: leads to ({x:.4f}, {y:.4f}) m: expected the place at ({spot.x:g}, {spot.y:g}) m"
        )
    if abs(math.remainder(phi, math.tau)) > _LEVEL:
        raise ParameterError(f"{where}.theta: expected link 3 along x, a sum of a multiple of 2 pi, got {phi:.4f}")
    for joint, volts in enumerate(holding(theta, arm, boxes.heaviest), 1):
        if abs(volts) > VOLTAGE_LIMIT:
            raise ParameterError(
                f"{where}: joint {joint} would need {abs(volts):.1f} V to hold {boxes.heaviest:g} kg there:"
                f" expected at most {VOLTAGE_LIMIT:g} V"
            )
    return Place(spot.x, spot.y, theta)


def holding(theta: JointVector, arm: ArmParameters, load: float) -> JointVector:
    """Voltages with which joints 1 to 3 hold an arm still, V: the moments of all weights beyond a joint, over K.

    Args:
        theta: joint angles, rad.
        arm: parameters of the arm.
        load: mass at the tip, kg.
    """
    points = joint_positions(theta, arm)
    weights = [(load, points[3][0])]
    angle = 0.0
    for (x, _), joint, mass, com in zip(points, theta, arm.mass, arm.com, strict=False):
        angle += joint
        weights.append((mass, x + com * math.cos(angle)))
    moments = []
    for first, (x, _) in enumerate(points[:3]):
        beyond = (weights[0], *weights[1 + first :])
        moments.append(GRAVITY * sum(mass * (at - x) for mass, at in beyond) / arm.voltage_constant[first])
    return tuple(moments)


def _rgb(name: str, text: str | None) -> RGB:
    """A drawn colour, #rrggbb; that of the usual cell, or grey, where the file says nothing."""
    if text is None:
        known = {destination.colour: destination.rgb for destination in DEFAULT_TASK.destinations}
        return known.get(name, GREY)
    try:
        red, green, blue = bytes.fromhex(text.removeprefix("#"))
    except ValueError:
        raise ModelError(f"places.{name}.rgb: expected #rrggbb, got {text!r}") from None
    return red, green, blue


def _read(where: str, content: Any, kind: type[T]) -> T:
    """A section as a struct.

    Raises:
        ModelError: a key is unknown or missing, or a value is of another kind.
    """
    if not isinstance(content, dict):
        raise ModelError(f"{where}: expected a section, got {content!r}")
    _check_keys(f"{where}.", content, msgspec.structs.fields(kind))
    return _convert(where, content, kind)


def _check_keys(where: str, content: Mapping[str, Any], known: Any) -> None:
    expected = [key if isinstance(key, str) else key.name for key in known]
    for key in content:
        if key not in expected:
            raise ModelError(f"unknown key {where}{key}: expected {choices(expected)}")


def _convert(where: str, value: Any, kind: Any) -> Any:
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        text, _, inner = str(error).partition(" - at `$")
        raise ModelError(f"{where}{inner.rstrip('`')}: {text[:1].lower()}{text[1:].replace('`', '')}") from None
