"""What was found of an arm, back in the files that it came from: URDF, and the file of an arm (docs/arms.md).

Model files know viscous and Coulomb friction and the inertia of rotors. The friction that was found has more terms;
it is told by the two numbers that are nearest to it, sliding steadily at a quarter to one and a half of the joint's
usual speed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from lxml import etree

from dtwin.arm.chain import Arm, Array, Friction, Joint, Link, Tolerances
from dtwin.arm.file import UNITS, ArmFile
from dtwin.arm.urdf import parse_urdf
from dtwin.errors import ModelError
from dtwin.files import replacing
from dtwin.identification.chain.friction import sliding
from dtwin.identification.chain.identify import Identification
from dtwin.identification.chain.result import moved

_SPEEDS: Final = np.linspace(0.25, 1.5, 26)
"""Speeds at which friction is told, in parts of the joint's usual one."""


def overlaid(found: Identification) -> Arm:
    """The arm with all that was found: bodies, and friction, rotor and constant of every joint.

    A rotor that did not prove itself is left as it was known, and so are friction and rotor of a joint that stood,
    and the constant where torques were logged.
    """
    joints = tuple(_joint(found, number) for number in range(len(found.arm)))
    return replace(found.arm, joints=joints)


def _joint(found: Identification, number: int) -> Joint:
    joint, names = found.arm.joints[number], found.design.names[number]
    place = found.moments.layout.friction(number)
    values = dict(zip(names, found.found.unknowns[place].tolist(), strict=True))
    slides = moved(found, number)
    viscous, coulomb = _plain(found, number)
    by_load = sum(value for name, value in values.items() if name.startswith("load"))
    actuator = joint.actuator
    if slides and found.found.used[place.start + names.index("rotor")]:
        actuator = replace(actuator, rotor=max(values["rotor"], 0.0))
    if found.design.kind != "torque":
        limit = actuator.limit if actuator.commanded == found.design.kind else np.inf
        gain = float(found.found.gain[number])
        actuator = replace(actuator, commanded=found.design.kind, constant=gain, limit=limit)
    elif actuator.stiffness is not None:
        gain = float(found.found.gain[number])
        actuator = replace(actuator, stiffness=gain * actuator.stiffness, damping=gain * actuator.damping)
    friction = Friction(viscous, coulomb, max(by_load, 0.0)) if slides else joint.friction
    return replace(joint, actuator=actuator, friction=friction)


def _plain(found: Identification, number: int) -> tuple[float, float]:
    """The viscous and the Coulomb friction of a joint, at least 0, nearest to what was found without load."""
    from scipy.optimize import nnls  # loaded for a file alone that is written

    scale, names = found.design.scales[number], found.design.names[number]
    place = found.moments.layout.friction(number)
    speeds = _SPEEDS * scale.speed
    losses = np.array(
        [
            0.5 * (sliding(names, scale, v) - sliding(names, scale, -v)) @ found.found.unknowns[place]
            for v in speeds.tolist()
        ]
    )
    (viscous, coulomb), _ = nnls(np.stack([speeds, np.ones_like(speeds)], axis=1), losses)
    return float(viscous), float(coulomb)


def write_urdf(found: Identification, template: Path, path: Path) -> None:
    """Writes a URDF with the bodies and the friction that were found; frames, joints and meshes are the template's.

    Links that are welded to a link of the chain lose their inertial elements: the body that was found has them in it.

    Raises:
        ModelError: the template is no longer that of the arm.
        RecordingError: the path cannot be written.
    """
    tree = parse_urdf(template)
    root = tree.getroot()
    elements = {link.get("name"): link for link in root.findall("link")}
    below: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            below.setdefault(parent.get("link"), []).append(child.get("link"))
    arm = overlaid(found)
    chain = {link.name for link in arm.links}
    for body in arm.links:
        if body.name not in elements:
            raise ModelError(f"{template}: expected a link {body.name!r}")
        _replace(elements[body.name], body)
        hanging = [name for name in below.get(body.name, ()) if name not in chain]
        while hanging:
            name = hanging.pop()
            hanging += below.get(name, ())
            inertial = elements[name].find("inertial")
            if inertial is not None:
                elements[name].remove(inertial)
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    for mine in arm.joints:
        if mine.name not in joints:
            raise ModelError(f"{template}: expected a joint {mine.name!r}")
        dynamics = joints[mine.name].find("dynamics")
        if dynamics is None:
            dynamics = etree.SubElement(joints[mine.name], "dynamics")
        dynamics.set("damping", f"{mine.friction.viscous:.9g}")
        dynamics.set("friction", f"{mine.friction.coulomb:.9g}")
    with replacing(path, ".urdf") as temporary:
        tree.write(temporary, encoding="utf-8", xml_declaration=True)


def _replace(element: etree._Element, body: Link) -> None:
    old = element.find("inertial")
    if old is not None:
        element.remove(old)
    inertial = etree.SubElement(element, "inertial")
    etree.SubElement(inertial, "origin", xyz=_words(body.centre), rpy="0 0 0")
    etree.SubElement(inertial, "mass", value=f"{body.mass:.12g}")
    xx, xy, yy, xz, yz, zz = (f"{x:.12g}" for x in body.inertia[np.tril_indices(3)])
    etree.SubElement(inertial, "inertia", ixx=xx, ixy=xy, ixz=xz, iyy=yy, iyz=yz, izz=zz)


def _words(numbers: Array) -> str:
    return " ".join(f"{x:.12g}" for x in numbers)


def write_arm(found: Identification, known: ArmFile, model: Path, path: Path) -> None:
    """Writes the file of the arm with what was found, which `dtwin run --arm` and all other commands take.

    Args:
        found: what was found.
        known: what the file says that the arm came from, whose other keys are kept.
        model: the model with the bodies that were found, in the same folder.
        path: file to write, *.toml.

    Raises:
        ModelError: the model lies in another folder.
        RecordingError: the path cannot be written.
    """
    if model.resolve().parent != path.resolve().parent:
        raise ModelError(f"{path}: expected the model in the same folder, got {model}")
    lines = [f"model = {_text(model.name)}"]
    lines += [f"tip = {_text(known.tip)}"] if known.tip else []
    lines += [f"tool = {list(known.tool)!r}"] if known.tool else []
    lines += [f"period = {found.arm.period!r}"]
    for joint in overlaid(found).joints:
        lines += ["", f"[joints.{_text(joint.name)}]"]
        said = dict(known.joints.get(joint.name, {})) | dict(_numbers(found, joint))
        lines += [f"{key} = {_text(v) if isinstance(v, str) else repr(v)}" for key, v in said.items()]
    if known.tolerances != Tolerances():
        lines += ["", "[tolerances]", *(f"{k} = {v!r}" for k, v in asdict(known.tolerances).items())]
    lines += ["", "[gripper]", f"payload = {known.payload!r}"] if known.payload is not None else []
    with replacing(path, ".toml") as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _numbers(found: Identification, joint: Joint) -> Iterator[tuple[str, float | str]]:
    """What was found of a joint, by the keys of an arm's file."""
    actuator, friction = joint.actuator, joint.friction
    if found.design.kind != "torque" and actuator.constant is not None:
        yield "commanded", next(unit for unit, kind in UNITS.items() if kind == actuator.commanded)
        yield "constant", actuator.constant / actuator.gear
    if actuator.commanded == "position" and actuator.stiffness is not None:
        yield "stiffness", actuator.stiffness
        yield "damping", actuator.damping
    if actuator.rotor is not None:
        yield "rotor", actuator.rotor / actuator.gear**2
    yield "viscous", friction.viscous
    yield "coulomb", friction.coulomb
    yield "load", friction.load


def _text(value: str) -> str:
    """As TOML, whose basic strings are those of JSON."""
    return msgspec.json.encode(value).decode()
