"""The variables of the models of any serial arm; joints are counted from 1, from the base on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

import numpy as np

from dtwin.arm.chain import INERTIAL, Arm, Array, Joint
from dtwin.controller.chain.application import SEQUENCE, STOP, joint_name
from dtwin.equations.native import width_of
from dtwin.fmu.ranges import STEPS, Range
from dtwin.fmu.variables import BOX_MASS, TIME, Value, Variability, Variable

POSITIONS: Final[Range] = (-1e3, 1e3)
"""A position, rad or m."""
VELOCITIES: Final[Range] = (-1e3, 1e3)
COMMANDS: Final[Range] = (-1e9, 1e9)
"""A command: what a drive cannot take is clipped."""
PAYLOADS: Final[Range] = (0.0, 1e3)
WIDTHS: Final[Range] = (1e-6, 1e2)
_LARGE: Final = 1e9
_EITHER: Final[Range] = (-_LARGE, _LARGE)
_POSITIVE: Final[Range] = (0.0, _LARGE)
_BODY: Final = {
    "m": ("mass", "kg", (0.0, 1e5)),
    "mc": ("first moment of mass along {axis}", "kg m", (-1e6, 1e6)),
    "I": ("element {axis} of the inertia about the origin of its frame", "kg m^2", (-1e6, 1e6)),
}
_DRIVE: Final = ("constant", "limit", "rotor", "viscous", "coulomb", "share")
_OF_JOINT: Final[Mapping[str, tuple[str, Range]]] = {
    "KP": ("Feedback of the position of joint {}", _POSITIVE),
    "KI": ("Feedback of the integral of the error of joint {}", _POSITIVE),
    "KD": ("Feedback of the velocity of joint {}", _POSITIVE),
    "BANDWIDTH": ("Bandwidth of the observer of joint {}", (1e-3, 1e6)),
    "DELAY": ("Time from a sample until its command acts, that joint {} reckons with", (0.0, 1.0)),
    "SPEED": ("Largest speed of joint {} along its path", (1e-9, _LARGE)),
    "ACCELERATION": ("Largest acceleration of joint {} along its path", (1e-9, _LARGE)),
    "TORQUE_CONSTANT": ("Torque or force of joint {} for a unit of its command, as the blocks know it", _EITHER),
    "LARGEST": ("Largest command of joint {}", (0.0, _LARGE)),
    "ROTOR": ("Inertia of the rotor at joint {}, as the blocks know it", _POSITIVE),
    "VISCOUS": ("Viscous friction of joint {}, as the blocks know it", _POSITIVE),
    "COULOMB": ("Coulomb friction of joint {}, as the blocks know it", _POSITIVE),
    "SHARE": ("Friction of joint {} in parts of the torque carried, as the blocks know it", (0.0, 1.0)),
    "M": ("Mass of link {}, as the blocks know it", (0.0, 1e5)),
}
"""Inputs of a block CHAIN_JOINT that are parameters."""
_OF_SEQUENCE: Final[Mapping[str, tuple[str, Range, str]]] = {
    "DWELL": ("Time in every pose", (0.0, _LARGE), "s"),
    "TOLERANCE": ("Largest distance of a joint from its pose when the gripper moves", (1e-9, _LARGE), ""),
    "PAYLOAD": ("Mass of a box that the blocks reckon with", PAYLOADS, "kg"),
}


def arm_variables(arm: Arm, step: float) -> list[Variable]:
    """The variables of an arm alone.

    Args:
        arm: what it is at first.
        step: longest step of its integration at first, s.
    """
    drives = [
        _real(f"u{k}", "input", "continuous", f"arm.u[{k - 1}]", f"Command of the drive of {joint.name}", 0.0)(
            joint.command_unit, COMMANDS
        )
        for k, joint in enumerate(arm.joints, 1)
    ]
    payload = _real("payload", "input", "continuous", "arm.payload", "Point mass at the tool", 0.0)("kg", PAYLOADS)
    acting = (*(each.name for each in drives), payload.name)
    start = np.zeros(len(arm))
    return [TIME, *_arm_parameters(arm, step, start, ""), *drives, payload, *_motion(arm, "", acting)]


def controller_variables(known: Arm, values: Mapping[str, Any], poses: int) -> list[Variable]:
    """The variables of the control application alone.

    Args:
        known: the arm as the blocks know it.
        values: the values of the inputs of its blocks.
        poses: number of its poses.
    """
    sample = [
        _real(f"q{k}", "input", "discrete", f"control.q[{k - 1}]", f"Position of {joint.name}", 0.0)(
            _unit(joint, ""), POSITIONS
        )
        for k, joint in enumerate(known.joints, 1)
    ]
    return [TIME, *_settings(known, values, poses), *sample, _box(0), *_commands(known)]


def cell_variables(
    arm: Arm, step: float, known: Arm, values: Mapping[str, Any], poses: int, start: Array
) -> list[Variable]:
    """The variables of an arm under its control application.

    Args:
        arm: what the arm is at first.
        step: longest step of its integration at first, s.
        known: the arm as the blocks know it.
        values: the values of the inputs of the blocks.
        poses: number of its poses.
        start: positions at the beginning, (n,).
    """
    mass = _real("box_mass", "input", "discrete", "box_mass", "Mass of the box that waits", BOX_MASS)("kg", PAYLOADS)
    payload = Variable("payload", "Float64", "output", "discrete", "arm.payload", "Mass at the tool", unit="kg")
    parameters = [*_arm_parameters(arm, step, start, "arm."), *_settings(known, values, poses)]
    sorts = int(values.get(f"{SEQUENCE}.PLACES", 0) > 0)
    return [TIME, *parameters, _box(sorts), mass, *_motion(arm, "arm.", ()), payload, *_commands(known)]


def exposed(joints: int, poses: int) -> frozenset[str]:
    """The inputs of the blocks that are parameters of controller and cell, elements of arrays by their number."""
    found = [f"{SEQUENCE}.{name}" for name in _OF_SEQUENCE]
    for k in range(joints):
        found += [f"{joint_name(k)}.{name}" for name in _OF_JOINT]
        found += [f"{joint_name(k)}.POSES[{row}]" for row in range(poses)]
    return frozenset(found)


def _unit(joint: Joint, over: str) -> str:
    return joint.unit + over


def _real(name: str, causality: Any, variability: Variability, member: str, text: str, start: float) -> Any:
    """A number, once its unit and its range are given."""

    def made(unit: str, bounds: Range) -> Variable:
        return Variable(name, "Float64", causality, variability, member, text, start, unit, bounds=bounds)

    return made


def _arm_parameters(arm: Arm, step: float, start: Array, prefix: str) -> Iterator[Variable]:
    def real(name: str, member: str, text: str, value: float, unit: str, bounds: Range, fixed: bool) -> Variable:
        variability: Variability = "fixed" if fixed else "tunable"
        full, place = f"{prefix}{name}", f"arm.{member}"
        return _real(full, "parameter", variability, place, text, float(value))(unit, bounds)

    for i, (joint, link) in enumerate(zip(arm.joints, arm.links, strict=True)):
        for place, (name, value) in enumerate(zip(INERTIAL, link.parameters, strict=True)):
            kind = "m" if name == "m" else name.rstrip("xyz")
            text, unit, bounds = _BODY[kind]
            said = f"Link {link.name}: {text.format(axis=name.removeprefix(kind))}"
            yield real(f"{name}_{i + 1}", f"body[{i}][{place}]", said, value, unit, bounds, False)
        for name, (value, unit, bounds, text) in _drive(joint).items():
            yield real(f"{name}_{i + 1}", f"{name}[{i}]", f"{joint.name}: {text}", value, unit, bounds, False)
    text = "Velocity over which dry friction changes its sign"
    yield real("coulomb_width", "coulomb_width", text, min(width_of(arm, step), WIDTHS[1]), "rad/s", WIDTHS, False)
    yield real("longest_step", "longest_step", "Longest step of the integration", step, "s", STEPS, True)
    for i, joint in enumerate(arm.joints):
        text = f"Position of {joint.name} at the start"
        yield real(f"q{i + 1}_start", f"q_start[{i}]", text, start[i], _unit(joint, ""), POSITIONS, True)
        text = f"Velocity of {joint.name} at the start"
        yield real(f"qd{i + 1}_start", f"qd_start[{i}]", text, 0.0, _unit(joint, "/s"), VELOCITIES, True)


def _drive(joint: Joint) -> dict[str, tuple[float, str, Range, str]]:
    actuator, friction = joint.actuator, joint.friction
    command, torque = joint.command_unit, joint.effort_unit
    by_command = "" if command == torque else f"{torque}/{command}"
    constant = 1.0 if actuator.constant is None else actuator.constant
    limit = min(actuator.limit, _LARGE)
    found = (
        (constant, by_command, _EITHER, "torque or force for a unit of the command"),
        (limit, command, _POSITIVE, "largest command of its drive"),
        (actuator.rotor or 0.0, "kg m^2" if joint.turns else "kg", _POSITIVE, "inertia of its rotor"),
        (friction.viscous, "N m s/rad" if joint.turns else "N s/m", _POSITIVE, "viscous friction"),
        (friction.coulomb, torque, _POSITIVE, "Coulomb friction"),
        (friction.load, "", (0.0, 1.0), "friction in parts of the torque that the gear carries"),
    )
    return dict(zip(_DRIVE, found, strict=True))


def _motion(arm: Arm, prefix: str, acting: tuple[str, ...]) -> Iterator[Variable]:
    """Motion of an arm whose parameters have a prefix, and whose accelerations follow some inputs at once."""
    positions, velocities = (tuple(f"{name}{k + 1}" for k in range(len(arm))) for name in ("q", "qd"))
    for i, (joint, name, speed) in enumerate(zip(arm.joints, positions, velocities, strict=True)):

        def output(
            own: str, member: str, what: str, over: str, by: str, at_once: tuple[str, ...], of: Joint = joint
        ) -> Variable:
            starts = None if own.startswith("qdd") else (f"{prefix}{own}_start",)
            text, unit = f"{what} of {of.name}", _unit(of, over)
            return Variable(
                own, "Float64", "output", "continuous", f"arm.{member}", text, None, unit, by, at_once, starts
            )

        yield output(name, f"q[{i}]", "Position", "", "", (name,))
        yield output(speed, f"qd[{i}]", "Velocity", "/s", name, (speed,))
        follows = (*positions, *velocities, *acting)
        yield output(f"qdd{i + 1}", f"qdd[{i}]", "Acceleration", "/s^2", speed, follows)


def _box(waits: int) -> Variable:
    text = "Number of the place of the box that waits, from 1; 0 if none waits"
    return Variable("box", "Int32", "input", "discrete", "control.box", text, waits, bounds=(0, 64))


def _commands(known: Arm) -> Iterator[Variable]:
    """What the controller answers, and where its path is."""
    for k, joint in enumerate(known.joints, 1):
        text = f"Command of the drive of {joint.name}"
        unit = joint.command_unit
        yield Variable(f"u{k}", "Float64", "output", "discrete", f"control.u[{k - 1}]", text, unit=unit)
    text = "Whether the gripper holds a box"
    yield Variable("box_gripped", "Boolean", "output", "discrete", "control.box_gripped", text)
    for k, joint in enumerate(known.joints):
        name, text = f"{joint_name(k)}.Q_D", f"Desired position of {joint.name}"
        member = f"control.program.{name}"
        yield Variable(name, "Float64", "output", "discrete", member, text, unit=_unit(joint, ""))
    for name, text in ((f"{SEQUENCE}.INDEX", "Number of the pose that comes next, from 0"), (f"{STOP}.STOP", _STOPS)):
        yield Variable(name, "Int32", "output", "discrete", f"control.program.{name}", text)


_STOPS: Final = "Stop in force: 0 none, 1 braking, 2 standstill, 3 torque off"


def _settings(known: Arm, values: Mapping[str, Any], poses: int) -> Iterator[Variable]:
    """The inputs of the blocks that hold settings, by the names of the blocks; they count from the start on."""

    def parameter(name: str, text: str, start: Value, bounds: Range, unit: str) -> Variable:
        member = f"control.program.{name}"
        return Variable(name, "Float64", "parameter", "fixed", member, text, start, unit, bounds=bounds)

    for name, (text, bounds, unit) in _OF_SEQUENCE.items():
        full = f"{SEQUENCE}.{name}"
        yield parameter(full, text, float(values[full]), bounds, unit)
    for k, joint in enumerate(known.joints):
        for name, (text, bounds) in _OF_JOINT.items():
            full = f"{joint_name(k)}.{name}"
            yield parameter(full, text.format(joint.name), float(values[full]), bounds, "")
        for row in range(poses):
            full = f"{joint_name(k)}.POSES[{row}]"
            text = f"Position of {joint.name} in pose {row + 1}"
            yield parameter(full, text, float(values[f"{joint_name(k)}.POSES"][row]), POSITIONS, _unit(joint, ""))
