"""The MuJoCo model of arm and gripper, compiled from models/arm.xml."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from copy import copy
from functools import lru_cache
from pathlib import Path
from typing import Final

import mujoco

from dtwin.emulation.contact.bodies import Bodies
from dtwin.errors import ModelError, choices

LINKS: Final = ("link_1", "link_2", "link_3")
JOINT_NAMES: Final = ("joint_1", "joint_2", "joint_3", "gripper")
ACTUATORS: Final = ("motor_1", "motor_2", "motor_3", "motor_gripper")
SENSORS: Final = ("theta_1", "theta_2", "theta_3", "omega_1", "omega_2", "omega_3", "gripper")
SITES: Final = ("tip", "pickup", "blue", "red", "green")
_NAMES_A_FILE: Final = re.compile(rb"\bfile\w*\s*=")
"""An attribute such as file or fileright: MJCF that takes something from another file has one."""


def ideal_arm(file: Path) -> mujoco.MjModel:
    """The compiled model of an ideal arm alone; of a file that names no other one it is compiled once.

    Raises:
        ModelError: the file is missing, malformed, or lacks a name.
    """
    try:
        content = file.read_bytes()
    except OSError:
        content = None  # The reason is told by what compiles it.
    if content is None or _NAMES_A_FILE.search(content):
        return compile_arm(file, None, 0.0, None)
    return copy(_kept_arm(file, content))


@lru_cache(maxsize=8)
def _kept_arm(file: Path, content: bytes) -> mujoco.MjModel:
    return compile_arm(file, None, 0.0, None)


def compile_arm(
    file: Path, extend: Callable[[mujoco.MjSpec], None] | None, step: float, bodies: Bodies | None
) -> mujoco.MjModel:
    """The compiled model of the parts that move, checked for all the names that a plant uses, then extended.

    Args:
        file: MJCF file with the names of models/arm.xml.
        extend: adds to the arm what a machine has beside it; None for nothing.
        step: integration step, s, which only bodies ask for.
        bodies: what touches the arm and one another; None for an arm alone.

    Raises:
        ModelError: the file is missing, malformed, or lacks a name.
    """
    spec = named_spec(file)
    try:
        if bodies:
            for kind, names in bodies.needed.items():
                require(file, kind, spec.bodies if kind == "body" else spec.geoms, names)
        for element in (*spec.cameras, *spec.lights, *spec.sensors, *spec.keys, *spec.sites):
            spec.delete(element)
        # Nobody looks at the plant, and MuJoCo takes longer to paint textures than for all else.
        for material in spec.materials:
            material.textures = [""] * len(material.textures)
        for texture in spec.textures:
            spec.delete(texture)
        for geom in list(spec.geoms):
            if not bodies or not (geom.contype or geom.conaffinity):
                spec.delete(geom)
        for body in spec.bodies:
            if not bodies and body.name not in ("world", *LINKS, "jaw", "tip"):
                spec.delete(body)
        model = spec.compile()
        joints = tuple(model.joint(i).name for i in range(model.njnt))
        actuators = tuple(model.actuator(i).name for i in range(model.nu))
        for kind, found, expected in (("joint", joints, JOINT_NAMES), ("actuator", actuators, ACTUATORS)):
            if found != expected:
                raise ModelError(f"{file}: {kind}s are {', '.join(found)}, expected exactly {', '.join(expected)}")
        if extend:
            extend(spec)
        if bodies:
            bodies.extend(spec, step)
        return spec.compile() if extend or bodies else model
    except ValueError as error:
        raise ModelError(one_line(file, str(error))) from None


def named_spec(file: Path) -> mujoco.MjSpec:
    """The content of an MJCF file, checked for the names of models/arm.xml that a plant uses.

    Raises:
        ModelError: the file is missing, malformed, or lacks a name.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(file))
    except ValueError as error:
        raise ModelError(one_line(file, str(error))) from None
    require(file, "body", spec.bodies, (*LINKS, "jaw", "tip"))
    require(file, "joint", spec.joints, JOINT_NAMES)
    require(file, "actuator", spec.actuators, ACTUATORS)
    require(file, "sensor", spec.sensors, SENSORS)
    require(file, "site", spec.sites, SITES)
    return spec


def require(file: Path, kind: str, elements: Iterable[mujoco.MjsElement], names: Iterable[str]) -> None:
    """Checks that the content of a file has elements of a kind with some names.

    Raises:
        ModelError: a name is missing.
    """
    present = {element.name for element in elements}
    for name in names:
        if name not in present:
            raise ModelError(f"{file}: no {kind} is named {name!r}, expected {kind}s {choices(names)}")


def one_line(file: Path, message: str) -> str:
    """A message of MuJoCo about a file in one line, which begins with the file and the number of its line."""
    text = " ".join(message.split())
    line = re.search(r"[Ll]ine(?: number=|\s+)(\d+)", text)
    return f"{file}:{line.group(1)}: {text}" if line else f"{file}: {text}"
