"""Writes the MJCF file of the cell with identified values in place of those of the data sheet."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from lxml import etree

from dtwin.errors import ModelError
from dtwin.files import replacing
from dtwin.parameters import ROOT, ArmParameters

MODEL_FILE: Final = ROOT / "models" / "arm.xml"
_AXIAL_INERTIA: Final = 0.1
"""Moment of inertia about a link's own axis relative to that about its joint axis, which alone matters."""


def export_mjcf(arm: ArmParameters, path: Path, template: Path = MODEL_FILE) -> None:
    """Writes the template with the arm's masses, inertias, lengths, damping and motor constants.

    Coulomb friction is written as MuJoCo's `frictionloss`, the nearest term that MJCF has.

    Raises:
        ModelError: the template lacks a name.
        RecordingError: the path cannot be written.
    """
    try:
        tree = etree.parse(template, etree.XMLParser(resolve_entities=False, no_network=True))
    except (OSError, etree.XMLSyntaxError) as error:
        raise ModelError(f"{template}: expected an MJCF file: {error}") from None
    outward = ("link_2", "link_3", "tip")
    for i, beyond in enumerate(outward):
        joint = i + 1
        inertial = _named(tree, template, "body", f"link_{joint}").find("inertial")
        if inertial is None:
            raise ModelError(f"{template}: body link_{joint} has no inertial")
        inertia = arm.inertia[i]
        inertial.set("pos", f"{arm.com[i]!r} 0 0")
        inertial.set("mass", repr(arm.mass[i]))
        inertial.set("diaginertia", f"{_AXIAL_INERTIA * inertia!r} {inertia!r} {inertia!r}")
        _named(tree, template, "body", beyond).set("pos", f"{arm.length[i]!r} 0 0")
        hinge = _named(tree, template, "joint", f"joint_{joint}")
        hinge.set("damping", repr(arm.damping[i]))
        if arm.coulomb[i]:
            hinge.set("frictionloss", repr(arm.coulomb[i]))
        _named(tree, template, "general", f"motor_{joint}").set("gainprm", repr(arm.voltage_constant[i]))
    with replacing(path) as temporary:
        tree.write(temporary, encoding="utf-8")


def _named(tree: etree._ElementTree, template: Path, tag: str, name: str) -> etree._Element:
    found = tree.find(f".//{tag}[@name='{name}']")
    if found is None:
        raise ModelError(f"{template}: no {tag} is named {name!r}")
    return found
