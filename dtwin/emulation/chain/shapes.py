"""The models with the shapes of a file, in the order in which they are tried."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import mujoco
from lxml import etree

from dtwin.arm.urdf import parse_urdf


def readers_of(path: Path) -> list[Callable[[], mujoco.MjSpec]]:
    """What reads a file with shapes to draw: of a URDF first what is for the eye.

    They raise ValueError or ModelError where the file cannot be read.
    """
    readers: list[Callable[[Path], mujoco.MjSpec]] = [lambda given: mujoco.MjSpec.from_file(str(given))]
    if path.suffix.lower() == ".urdf":
        readers.insert(0, _with_visuals)
    return [partial(read, path) for read in readers]


def name_for_entities(spec: mujoco.MjSpec) -> None:
    """Takes the blanks out of the names of bodies, which are parts of paths of entities in recordings."""
    for body in spec.bodies:
        name = re.sub(r"\s+", "_", body.name)
        if name != body.name and spec.body(name) is None:
            body.name = name


def _with_visuals(path: Path) -> mujoco.MjSpec:
    """The model of a URDF with what it has for the eye, which MuJoCo leaves out unless the file asks for it.

    Collision shapes are left out of links that have something for the eye.
    """
    root = parse_urdf(path).getroot()
    own = root.find("mujoco")
    extension = etree.Element("mujoco") if own is None else own
    known = extension.find("compiler")
    compiler = etree.SubElement(extension, "compiler") if known is None else known
    compiler.set("discardvisual", "false")
    root.insert(0, extension)
    for link in root.iter("link"):
        if link.find("visual") is not None:
            for collision in link.findall("collision"):
                link.remove(collision)
    spec = mujoco.MjSpec.from_string(etree.tostring(root, encoding="unicode"))
    spec.modelfiledir = str(path.resolve().parent)
    return spec
