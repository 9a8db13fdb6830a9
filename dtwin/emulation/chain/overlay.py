"""An arm's numbers in its MJCF file: bodies, friction and rotors; frames, shapes and the rest stay as they are."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from dtwin.arm.chain import Arm, Joint, Link, steiner
from dtwin.emulation.chain.mjcf import compiled, jointed_below, quietly
from dtwin.emulation.chain.model import LOAD, chain_spec
from dtwin.emulation.model import one_line
from dtwin.errors import ModelError
from dtwin.files import replacing

_STEP: Final = 0.002
"""Integration step of a model that is made of a chain alone, MuJoCo's usual one, s."""


def write_mjcf(arm: Arm, template: Path | None, path: Path) -> None:
    """Writes an MJCF file.

    Bodies that are welded to a link lose their mass: the body of the link has it in it. What joints move beside the
    chain, such as fingers, keeps its own, which the link does not count.

    Args:
        arm: the arm, with the numbers that count.
        template: the MJCF file that its chain was read from; None makes a model of the chain alone, without shapes.
        path: file to write, *.xml.

    Raises:
        ModelError: the template is not that of the arm, or has a body that the numbers leave no mass for.
        RecordingError: the path cannot be written.
    """
    spec = _of_chain(arm) if template is None else _of_template(arm, template, path)
    with replacing(path, ".xml") as temporary:
        try:
            quietly(spec)
            temporary.write_text(spec.to_xml(), encoding="utf-8")
        except ValueError as error:
            raise ModelError(one_line(path, str(error))) from None


def _of_chain(arm: Arm) -> mujoco.MjSpec:
    spec = chain_spec(arm, _STEP)
    spec.delete(spec.body(LOAD))
    for joint in arm.joints:
        spec.joint(joint.name).frictionloss = joint.friction.coulomb
    return spec


def _of_template(arm: Arm, template: Path, path: Path) -> mujoco.MjSpec:
    model = compiled(template)
    spec = mujoco.MjSpec.from_file(str(template))
    for folder in ("meshdir", "texturedir"):
        there = (template.resolve().parent / getattr(spec, folder)).resolve()
        setattr(spec, folder, os.path.relpath(there, path.resolve().parent))
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    chain = {link.name for link in arm.links}
    for joint, link in zip(arm.joints, arm.links, strict=True):
        body = spec.body(link.name)
        if body is None or len(body.joints) != 1:
            raise ModelError(f"{template}: expected a body {link.name!r} with one joint, which moves it")
        _set_joint(body.joints[0], joint)
        anchor = np.array(model.jnt_pos[model.body(link.name).jntadr[0]])
        moved = jointed_below(model, model.body(link.name).id, {model.body(name).id for name in chain})
        here = Link(link.name, link.mass, link.centre + anchor, link.inertia)
        _set_body(template, body, _without(here, *moved))
        _empty_welded(body, chain)
    return spec


def _set_joint(element: mujoco.MjsJoint, joint: Joint) -> None:
    element.damping = np.array([joint.friction.viscous, 0.0, 0.0])
    element.frictionloss = joint.friction.coulomb
    element.armature = joint.actuator.rotor or 0.0


def _without(link: Link, mass: float, moment: np.ndarray, inertia: np.ndarray) -> Link:
    """A body without a part of it, whose moments are about the origin of the frame."""
    if not mass:
        return link
    rest = link.mass - mass
    if rest <= 0.0:
        return Link(link.name, rest, link.centre, link.inertia)
    centre = (link.mass * link.centre - moment) / rest
    whole = link.inertia + link.mass * steiner(link.centre) - inertia
    return Link(link.name, rest, centre, whole - rest * steiner(centre))


def _set_body(template: Path, body: mujoco.MjsBody, link: Link) -> None:
    if link.mass <= 0.0 or np.linalg.eigvalsh(link.inertia).min() <= 0.0:
        raise ModelError(
            f"{template}: body {link.name}: what joints move beside the chain is heavier there than what was found"
        )
    full = link.inertia
    body.explicitinertial = True
    body.mass, body.ipos = link.mass, link.centre
    body.iquat, body.inertia = [1.0, 0.0, 0.0, 0.0], np.zeros(3)
    body.fullinertia = [full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2]]


def _empty_welded(body: mujoco.MjsBody, chain: set[str]) -> None:
    """Takes the mass of the bodies that no joint moves against a link."""
    for child in body.bodies:
        if child.name in chain or child.joints:
            continue
        child.explicitinertial = True
        child.mass, child.ipos, child.iquat = 0.0, np.zeros(3), [1.0, 0.0, 0.0, 0.0]
        child.inertia, child.fullinertia = np.zeros(3), [np.nan, 0.0, 0.0, 0.0, 0.0, 0.0]
        _empty_welded(child, chain)
