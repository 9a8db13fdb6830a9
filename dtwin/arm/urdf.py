"""Reads the serial chain of a URDF file.

Fixed joints are welded: what hangs on a link by them is a part of it. Branches beside the chain, such as the fingers
of a gripper, are welded at their position 0 and told as a remark.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from lxml import etree

from dtwin.arm.chain import Arm, Array, Friction, Joint, JointKind, Link, steiner
from dtwin.arm.tip import ends_of, fingers_begin
from dtwin.errors import ModelError, choices
from dtwin.names import counted

_LARGEST: Final = 16_000_000
"""Largest size of a file that is read, bytes: descriptions of robots have some ten thousand."""
_MOST: Final = 500
"""Largest number of links; hands with all their fingers have some thirty."""
_KINDS: Final[Mapping[str, JointKind]] = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
}


@dataclass(frozen=True)
class _Edge:
    """A joint element with what it joins."""

    element: etree._Element
    name: str
    kind: str
    parent: str
    child: str


@dataclass(frozen=True)
class _Body:
    """Mass properties in the frame of the link that they are welded to."""

    mass: float
    moment: Array
    inertia: Array


class _File:
    """The elements of one file, found by name, with errors that name the line."""

    def __init__(self, path: Path) -> None:
        self.path = path
        root = parse_urdf(path).getroot()
        self.robot = root.get("name") or path.stem
        self.links = {self.text(link, "name"): link for link in root.findall("link")}
        self.edges = [self._edge(joint) for joint in root.findall("joint")]
        self.transmissions = list(root.iter("transmission"))
        self.below: dict[str, list[_Edge]] = {}
        self.above: dict[str, _Edge] = {}
        for edge in self.edges:
            if edge.child in self.above:
                both = f"joints {self.above[edge.child].name} and {edge.name}"
                raise self.error(
                    edge.element, f"expected one joint above link {edge.child}, got {both}: a closed loop"
                )
            self.below.setdefault(edge.parent, []).append(edge)
            self.above[edge.child] = edge
        if len(self.links) > _MOST:
            raise ModelError(f"{path}: expected at most {_MOST} links, got {len(self.links)}")
        for edge in self.edges:
            link, passed = edge.child, 0
            while link in self.above and passed <= len(self.edges):
                link, passed = self.above[link].parent, passed + 1
            if link in self.above:
                raise self.error(edge.element, f"joint {edge.name}: expected a tree, got a closed loop")

    def error(self, element: etree._Element, message: str) -> ModelError:
        return ModelError(f"{self.path}:{element.sourceline}: {message}")

    def text(self, element: etree._Element, attribute: str) -> str:
        value = element.get(attribute)
        if not value:
            raise self.error(element, f"<{element.tag}>: expected an attribute {attribute}")
        return str(value)

    def number(self, element: etree._Element, attribute: str) -> float:
        text = self.text(element, attribute)
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            raise self.error(element, f"<{element.tag} {attribute}={text!r}>: expected a finite number")
        return value

    def vector(self, element: etree._Element | None, attribute: str, default: tuple[float, ...]) -> Array:
        text = None if element is None else element.get(attribute)
        if element is None or text is None:
            return np.array(default)
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.array([])
        if values.shape != (3,) or not np.isfinite(values).all():
            raise self.error(element, f"<{element.tag} {attribute}={text!r}>: expected three finite numbers")
        return values

    def pose(self, element: etree._Element) -> tuple[Array, Array]:
        """Attitude (3, 3) and origin (3,) that the element <origin> inside gives."""
        origin = element.find("origin")
        zero = (0.0, 0.0, 0.0)
        return roll_pitch_yaw(self.vector(origin, "rpy", zero)), self.vector(origin, "xyz", zero)

    def _edge(self, joint: etree._Element) -> _Edge:
        ends = []
        for tag in ("parent", "child"):
            end = joint.find(tag)
            if end is None:
                raise self.error(joint, f"joint {joint.get('name')}: expected an element <{tag}>")
            link = self.text(end, "link")
            if link not in self.links:
                raise self.error(end, f"<{tag} link={link!r}>: expected one of the links, {choices(self.links)}")
            ends.append(link)
        return _Edge(joint, self.text(joint, "name"), self.text(joint, "type"), *ends)


def read_urdf(path: Path, base: str | None = None, tip: str | None = None) -> Arm:
    """Reads the chain from a link to another one.

    Args:
        path: URDF file; meshes are not looked at.
        base: link that stands still; None for the root of the tree.
        tip: last link of the chain; None for the one that most joints move, or where its fingers begin.

    Raises:
        ModelError: the file is no URDF, the chain is not clear, a joint is a mimic, or a link has no inertia. The
            message names file and line, what was expected and what was there.
    """
    file = _File(path)
    if not file.links:
        raise ModelError(f"{path}: expected links, got none: a part of a description, or one that was not expanded")
    roots = [name for name in file.links if name not in file.above]
    if base is None and len(roots) != 1:
        raise ModelError(f"{path}: expected one link without a joint above it, got {roots or 'none: a closed loop'}")
    start = _known(file, base or roots[0], "base")
    end = _known(file, tip, "tip") if tip else _tip(file, start)
    chain = list(_chain(file, start, end))
    remarks = [fingers_begin(end)] if not tip and any(_moved_by(file, end).values()) else []
    joints, bodies = [], []
    rotation, translation = np.eye(3), np.zeros(3)
    for edge in chain:
        turned, shifted = file.pose(edge.element)
        rotation, translation = rotation @ turned, translation + rotation @ shifted
        if edge.kind == "fixed":
            continue
        joints.append(_joint(file, edge, rotation, translation))
        rotation, translation = np.eye(3), np.zeros(3)
        inside = {other.child for other in chain if other.kind != "fixed"}
        body, frozen = _welded(file, edge.child, inside)
        remarks += [f"joint {name} is not in the chain: it is welded at 0" for name in frozen]
        bodies.append((edge.child, body))
    remarks += _reductions(file, [joint.name for joint in joints])
    return Arm(file.robot, tuple(joints), _links(file, bodies), remarks=tuple(remarks), tool=translation)


def _reductions(file: _File, joints: Sequence[str]) -> Iterator[str]:
    """What transmissions of ROS say of gears between one motor and one joint of the chain, as remarks."""
    for each in file.transmissions:
        names = {name for joint in each.iter("joint") if (name := joint.get("name"))}
        said = [*each.iter("mechanicalReduction"), *each.iter("mechanical_reduction")]
        if len(names) != 1 or len(said) != 1 or not names <= set(joints):
            continue
        text = (said[0].text or "").strip()
        try:
            gear = abs(float(text))
        except ValueError:
            gear = np.nan
        if not 0.0 < gear < np.inf:
            raise file.error(said[0], f"<{said[0].tag}>: expected a finite number other than 0, got {text!r}")
        if gear != 1.0:
            yield f"joint {names.pop()}: a transmission with gear = {gear:g}, for a rotor or a constant of the motor"


def parse_urdf(path: Path) -> Any:
    """The elements of a URDF file, an lxml element tree.

    Raises:
        ModelError: the file cannot be read, is too large, or is no URDF.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise ModelError(f"{path}: expected at most {_LARGEST} bytes, got {path.stat().st_size}")
        tree = _parsed(path)
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror or 'no XML'}") from None
    except etree.XMLSyntaxError as error:
        raise ModelError(f"{path}:{error.lineno}: expected XML: {error.msg}") from None
    root = tree.getroot()
    if root.tag != "robot":
        hint = "; this is a xacro, run xacro on it first" if path.suffix == ".xacro" else ""
        raise ModelError(f"{path}:{root.sourceline}: expected <robot>, got <{root.tag}>{hint}")
    return tree


def _parsed(path: Path) -> Any:
    """The elements of an XML file; a prefix that is declared nowhere is left in place, as readers of URDF do."""
    options: dict[str, Any] = {"resolve_entities": False, "no_network": True, "load_dtd": False}
    parser = etree.XMLParser(**options)
    try:
        return etree.parse(path, parser)
    except etree.XMLSyntaxError:
        # The log of the error would also hold the errors of files that were read before.
        if any(entry.domain_name != "NAMESPACE" for entry in parser.error_log):
            raise
        return etree.parse(path, etree.XMLParser(recover=True, **options))


def _known(file: _File, link: str, what: str) -> str:
    if link not in file.links:
        raise ModelError(f"{file.path}: {what} {link!r}: expected one of the links, {choices(file.links)}")
    return link


def _tip(file: _File, start: str) -> str:
    """The link at the end of the only path with the most joints, or where the fingers of that path begin."""
    moved = _moved_by(file, start)
    most = max(moved.values())
    if not most:
        raise ModelError(f"{file.path}: expected a joint that moves below link {start}, got none")
    last = [link for link, count in moved.items() if count == most and file.above[link].kind != "fixed"]
    paths = [[(edge.child, moved[edge.child]) for edge in _chain(file, start, link)] for link in last]
    ends = ends_of(paths)
    if len(ends) != 1:
        raise ModelError(
            f"{file.path}: expected a tip, as several chains have {counted(most, 'joint')}: {choices(sorted(ends))}"
        )
    return ends[0]


def _moved_by(file: _File, start: str) -> dict[str, int]:
    """Number of joints that move each link below a link."""
    found, waiting = {start: 0}, [start]
    while waiting:
        link = waiting.pop()
        for edge in file.below.get(link, ()):
            found[edge.child] = found[link] + (edge.kind != "fixed")
            waiting.append(edge.child)
    return found


def _chain(file: _File, start: str, tip: str) -> Iterator[_Edge]:
    """The joints from a link to another, from the base on."""
    edges: list[_Edge] = []
    link = tip
    while link != start:
        if link not in file.above:
            raise ModelError(f"{file.path}: expected link {tip} below link {start}")
        edges.append(file.above[link])
        link = edges[-1].parent
    yield from reversed(edges)


def _joint(file: _File, edge: _Edge, rotation: Array, translation: Array) -> Joint:
    mimic = edge.element.find("mimic")
    if mimic is not None:
        followed = mimic.get("joint")
        raise file.error(
            mimic, f"joint {edge.name} follows joint {followed}: expected joints that move by themselves"
        )
    if edge.kind not in _KINDS:
        valid = choices([*_KINDS, "fixed"])
        raise file.error(edge.element, f"joint {edge.name}: expected a type {valid}, got {edge.kind!r}")
    axis_element = edge.element.find("axis")
    axis = file.vector(axis_element, "xyz", (1.0, 0.0, 0.0))
    length = float(np.linalg.norm(axis))
    if not length:
        raise file.error(edge.element, f"joint {edge.name}: expected an axis, got 0 0 0")
    limit = edge.element.find("limit")
    bounds: dict[str, Any] = {}
    if limit is not None:
        bounds = {"lower": 0.0, "upper": 0.0}  # as URDF says of what is left out
        bounds |= {ours: file.number(limit, name) for name, ours in _BOUNDS.items() if limit.get(name)}
        bounds = {name: value for name, value in bounds.items() if name not in _UNSAID or value > 0.0}
        if bounds["lower"] == bounds["upper"] == 0.0:
            bounds |= {"lower": -np.inf, "upper": np.inf}
        if not bounds["lower"] < bounds["upper"]:
            got = f"{bounds['lower']:g} and {bounds['upper']:g}"
            raise file.error(limit, f"joint {edge.name}: expected lower below upper, got {got}")
    if edge.kind == "continuous":
        bounds |= {"lower": -np.inf, "upper": np.inf}
    bounds["friction"] = _friction(file, edge)
    return Joint(edge.name, _KINDS[edge.kind], axis / length, rotation, translation, **bounds)


def _friction(file: _File, edge: _Edge) -> Friction:
    """What <dynamics> says that a joint loses; what is left out there is 0."""
    dynamics = edge.element.find("dynamics")
    if dynamics is None:
        return Friction()
    found = {ours: file.number(dynamics, name) for name, ours in _LOSSES.items() if dynamics.get(name)}
    for name, ours in _LOSSES.items():
        if found.get(ours, 0.0) < 0.0:
            raise file.error(dynamics, f"joint {edge.name}: expected {name} of at least 0, got {found[ours]:g}")
    return Friction(**found)


_LOSSES: Final = {"damping": "viscous", "friction": "coulomb"}


_BOUNDS: Final = {"lower": "lower", "upper": "upper", "velocity": "speed", "effort": "effort"}
_UNSAID: Final = ("speed", "effort")
"""What files that do not know it give as 0, as they do with both ends of a range."""


def _welded(file: _File, link: str, chain: set[str]) -> tuple[_Body, list[str]]:
    """The mass properties of a link with all that hangs on it beside the chain, and the joints that were welded."""
    body, frozen = _own(file, link), []
    for edge in file.below.get(link, ()):
        if edge.child in chain:
            continue
        if edge.kind != "fixed":
            frozen.append(edge.name)
        turned, shifted = file.pose(edge.element)
        part, more = _welded(file, edge.child, chain)
        body, frozen = _together(body, _moved(part, turned, shifted)), frozen + more
    return body, frozen


def _own(file: _File, link: str) -> _Body:
    element = file.links[link].find("inertial")
    if element is None:
        return _Body(0.0, np.zeros(3), np.zeros((3, 3)))
    parts = {tag: element.find(tag) for tag in ("mass", "inertia")}
    for tag, part in parts.items():
        if part is None:
            raise file.error(element, f"link {link}: expected an element <{tag}>")
    mass = file.number(parts["mass"], "value")
    ixx, ixy, ixz, iyy, iyz, izz = (file.number(parts["inertia"], f"i{axes}") for axes in _AXES)
    if mass < 0.0:
        raise file.error(element, f"link {link}: expected a mass of at least 0 kg, got {mass:g}")
    about_centre = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    if np.linalg.eigvalsh(about_centre).min() < -1e-9 * max(1.0, np.abs(about_centre).max()):
        raise file.error(
            element, f"link {link}: expected a positive inertia, got one with a negative principal moment"
        )
    rotation, centre = file.pose(element)
    inertia = rotation @ about_centre @ rotation.T + mass * steiner(centre)
    return _Body(mass, mass * centre, inertia)


_AXES: Final = ("xx", "xy", "xz", "yy", "yz", "zz")


def _moved(body: _Body, rotation: Array, translation: Array) -> _Body:
    """The body in the frame of the link that it is welded to."""
    if not body.mass:
        return _Body(0.0, np.zeros(3), rotation @ body.inertia @ rotation.T)
    centre = body.moment / body.mass
    central = body.inertia - body.mass * steiner(centre)
    there = rotation @ centre + translation
    return _Body(body.mass, body.mass * there, rotation @ central @ rotation.T + body.mass * steiner(there))


def _together(one: _Body, other: _Body) -> _Body:
    return _Body(one.mass + other.mass, one.moment + other.moment, one.inertia + other.inertia)


def _links(file: _File, bodies: Sequence[tuple[str, _Body]]) -> tuple[Link, ...]:
    """The links with their mass properties about their centres."""
    light = [name for name, body in bodies if not body.mass]
    if light:
        first, *others = light
        also = f"; {', '.join(others)} lack{'s' * (len(others) == 1)} it too" if others else ""
        message = f"link {first}: expected an <inertial> with a mass above 0{also}"
        raise file.error(file.links[first], message)
    centred = [(name, body, body.moment / body.mass) for name, body in bodies]
    return tuple(
        Link(name, body.mass, centre, body.inertia - body.mass * steiner(centre)) for name, body, centre in centred
    )


def roll_pitch_yaw(angles: Array) -> Array:
    """The attitude (3, 3) of URDF's rpy, (3,), rad: turned about the fixed axes x, y and z in this order."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
