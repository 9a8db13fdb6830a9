"""`dtwin arm import`, `show`, `check` and `list`."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from rich.table import Table

from dtwin.arm.chain import Arm, Array, Joint
from dtwin.arm.file import FOLDER, SUFFIX, names
from dtwin.arm.packages import installed
from dtwin.arm.poses import drawn_poses
from dtwin.arm.text import findings, imported, summary
from dtwin.commands.frame import JsonOption
from dtwin.controller.chain.application import Control
from dtwin.emulation.chain.arms import arm_of, chain_of
from dtwin.equations.rigid import inverse_dynamics
from dtwin.errors import DtwinError, ModelError
from dtwin.files import ensure_writable, replacing
from dtwin.run.margins.chain import margins
from dtwin.run.margins.gears import control_of
from dtwin.run.reserve import asked
from dtwin.terminal import as_text, print_json, print_table, printable

_POSES = 200
"""Poses at which the drives are asked whether they hold the arm."""


@dataclass(frozen=True)
class ArmImport:
    """Make the file of an arm from its model: what the model tells, and line by line what a person must add.

    What is no serial chain is refused: joints that follow others, closed loops, bodies without mass.
    """

    model: Annotated[Path, tyro.conf.Positional]
    """MJCF (.xml) or URDF file of the arm, or package://NAME/FILE for one of an installed Python package."""
    tip: str | None = None
    """Last link of the chain; the end of the longest chain if not given."""
    out: Path | None = None
    """TOML file to write, called as the model if not given, and beside it, or here if it is one of a package."""

    def execute(self) -> int:
        file = installed(self.model)
        path = self.out or (file if file == self.model else Path(file.name)).with_suffix(SUFFIX)
        if self.out is None and path.exists():
            raise ModelError(f"{path}: is there already: give --out FILE to write another one")
        chain = chain_of(file, self.tip)
        ensure_writable(path, SUFFIX)
        model = os.path.relpath(file.absolute(), path.absolute().parent)
        with replacing(path, SUFFIX) as temporary:
            temporary.write_text(imported(chain, Path(model).as_posix(), self.tip))
        _print([*summary(chain), *_unlikely(chain), *findings(arm_of(str(path))), f"written: {path}"])
        return 0


@dataclass(frozen=True)
class ArmShow(JsonOption):
    """Show an arm: its joints, drives, limits and links."""

    arm: tyro.conf.Positional[str] = "thesis"
    """Name of arms/, file of an arm (*.toml), or a model (*.urdf, *.xml)."""

    def execute(self) -> int:
        arm = arm_of(self.arm)
        if self.json:
            print_json(as_object(arm))
            return 0
        _print(summary(arm))
        print_table(_table(arm))
        print("friction: viscous (a rad/s or m/s) + Coulomb + the share that grows with the load; N m or N")
        return 0


@dataclass(frozen=True)
class ArmCheck:
    """Check the file of an arm; tell what is still to be added. The exit status is 1 if something is."""

    arm: tyro.conf.Positional[str] = "thesis"
    """Name of arms/, file of an arm (*.toml), or a model (*.urdf, *.xml)."""

    def execute(self) -> int:
        arm = arm_of(self.arm)
        found = findings(arm) or [*(_weak(arm) or _slow(arm)), *(_stiff(arm) if arm.servos else _unstable(arm))]
        _print([*summary(arm), *_unlikely(arm), *(found or ["it can be driven"])])
        return 1 if found else 0


@dataclass(frozen=True)
class ArmList(JsonOption):
    """List the arms of the folder arms/."""

    def execute(self) -> int:
        lines: dict[str, str] = {}
        for name in names():
            try:
                lines[name] = summary(arm_of(str(FOLDER / f"{name}{SUFFIX}")))[0].partition(": ")[2]
            except DtwinError as error:
                lines[name] = str(error)
        if self.json:
            print_json(lines)
            return 0
        table = Table("arm", "what it is")
        for name, line in lines.items():
            table.add_row(as_text(name), as_text(line))
        print_table(table)
        return 0


def _weak(arm: Arm) -> list[str]:
    """Which joints do not hold the arm at some of the drawn poses, as lines for people; nothing if all do."""
    poses = drawn_poses(arm, _POSES, np.random.default_rng(0), 1.0).positions
    rest = np.zeros_like(poses)
    needed = np.max(np.abs(inverse_dynamics(arm, poses, rest, rest)), axis=0)
    todo = "to hold the arm at some poses: correct limit, constant or effort, or narrow lower and upper"
    return _lacking(arm, needed, todo)


def _slow(arm: Arm) -> list[str]:
    """Which joints cannot go from one drawn pose to another as fast as the file says, as lines for people."""
    poses = drawn_poses(arm, _POSES, np.random.default_rng(0)).positions
    needed = asked(arm, poses[:-1], poses[1:])
    todo = "on some ways: lower speed and acceleration, or correct limit, constant, effort, friction and rotor"
    return _lacking(arm, needed, todo)


def _lacking(arm: Arm, needed: Array, todo: str) -> list[str]:
    """The joints whose drives give less than is needed, (n,), N m or N, as lines for people with what to do."""
    return [
        f"joints.{joint.name}: its drive gives {joint.largest:.3g} {joint.effort_unit} at most, and {most:.3g} "
        f"{joint.effort_unit} are needed {todo}"
        for joint, most in zip(arm.joints, needed, strict=True)
        if most > joint.largest
    ]


def _stiff(arm: Arm) -> list[str]:
    """Which drives that take positions are too stiff for the tick, as lines for people.

    Blocks command no more than the position that was measured and what the loop's largest torque takes. Where a joint
    goes that far in a tick, its drive lets it go before the next command, so that paths keep to `Arm.path_speeds`.
    """
    lines = []
    for joint, kept in zip(arm.joints, arm.path_speeds.tolist(), strict=True):
        stiffness = joint.actuator.stiffness
        if stiffness is None or joint.speed <= kept:
            continue
        lines.append(
            f"joints.{joint.name}: its loop gives all of its torque {joint.largest / stiffness:.2g} {joint.unit} off "
            f"its command, and it goes {joint.speed * arm.period:.2g} {joint.unit} in a tick: shorten period, or "
            f"lower speed; its paths keep to {kept:.3g} {joint.unit}/s"
        )
    return lines


def _unlikely(arm: Arm) -> list[str]:
    """Links whose mass would have to lie farther out than the whole arm is long, as lines for people."""
    reach = sum(float(np.linalg.norm(joint.translation)) for joint in arm.joints)
    lines = []
    for link in arm.links:
        radius = float(np.sqrt(np.linalg.eigvalsh(link.inertia)[-1] / link.mass)) if link.mass else 0.0
        if radius > reach > 0.0:
            said = f"its inertia is that of {link.mass:.3g} kg at {radius:.3g} m from its centre"
            lines.append(f"note: link {link.name}: {said}, in an arm of {reach:.3g} m: is it a placeholder?")
    return lines


def _unstable(arm: Arm) -> list[str]:
    """Why the loop would fall over at some of the drawn poses, as lines for people; nothing if it does not."""
    try:
        if all(each.stable for each in margins(arm, control_of(arm))):
            return []
    except ModelError as error:
        return [str(error)]
    return [
        "the loop is not stable at all poses: bodies are so light that gravity moves them faster than the feedback "
        f"of {Control().pole:g} rad/s; motors and gears are not in the model: add rotor, gear and viscous",
        f"`dtwin margins --arm {arm.name}` tells by how much",
    ]


def as_object(arm: Arm) -> dict[str, Any]:
    """An arm as an object for programs, SI units; what is not known or has no limit is null."""

    def number(value: float | None) -> float | None:
        return value if value is not None and np.isfinite(value) else None

    return {
        "name": arm.name,
        "period": arm.period,
        "payload": arm.gripper.payload if arm.gripper else None,
        "remarks": list(arm.remarks),
        "joints": [
            {
                "name": joint.name,
                "kind": joint.kind,
                "lower": number(joint.lower),
                "upper": number(joint.upper),
                "speed": number(joint.speed),
                "acceleration": number(joint.acceleration),
                "commanded": joint.actuator.commanded,
                "constant": number(joint.actuator.constant),
                "limit": number(joint.actuator.limit),
                "stiffness": number(joint.actuator.stiffness),
                "damping": joint.actuator.damping,
                "effort": number(joint.effort),
                "rotor": number(joint.actuator.rotor),
                "viscous": joint.friction.viscous,
                "coulomb": joint.friction.coulomb,
                "load": joint.friction.load,
                "encoder": joint.step,
                "mass": link.mass,
                "centre": link.centre.tolist(),
                "inertia": link.inertia.tolist(),
            }
            for joint, link in zip(arm.joints, arm.links, strict=True)
        ],
    }


def _table(arm: Arm) -> Table:
    table = Table("joint", "range", "speed", "limit", "effort a unit", "friction", "link")
    for joint, link in zip(arm.joints, arm.links, strict=True):
        drive, friction = joint.actuator, joint.friction
        constant = drive.stiffness if drive.commanded == "position" else drive.constant
        values = (
            joint.name,
            f"{joint.lower:.3g} to {joint.upper:.3g} {joint.unit}",
            f"{joint.speed:.3g}",
            _limit(joint),
            "not known" if constant is None else f"{constant:.4g}",
            f"{friction.viscous:.3g} + {friction.coulomb:.3g} + {100.0 * friction.load:.2g} %",
            f"{link.mass:.3g} kg",
        )
        table.add_row(*map(as_text, values))
    return table


def _limit(joint: Joint) -> str:
    """The largest command; of a command in N m before a gear also what the joint has of it."""
    drive, unit = joint.actuator, joint.effort_unit
    if drive.commanded == "position":
        return f"{joint.effort:.4g} {unit}"
    told = f"{drive.limit:.4g} {joint.command_unit}"
    geared = drive.commanded == "torque" and drive.constant not in (None, 1.0) and math.isfinite(joint.largest)
    return f"{told}, {joint.largest:.4g} {unit} at the joint" if geared else told


def _print(lines: list[str]) -> None:
    for line in lines:
        print(printable(line))
