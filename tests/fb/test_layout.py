"""The files of fb/ as people read them in 4diac IDE: comments with units, and diagrams without overlaps."""

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import pytest

from iec61499 import model
from iec61499.library import Library
from tests.support.driven import FOLDER

TYPES = sorted(FOLDER.glob("*.fbt"))
SYSTEM = FOLDER / "dtwin.sys"
UNIT = re.compile(r"\bin (rad|rad/s|rad/s\^2|rad s|V|s|kg|kg m|kg m\^2|m|N m|N m/V|N m s/rad|1/s|1/s\^2|1/s\^3)\b")
PURE_NUMBERS = {
    *(
        "TICK",
        "SAMPLES",
        "CONFIDENCE",
        "CONFIDENCE_LIMIT",
        "SATURATED",
        "SATURATION_LIMIT",
        "DOUBT",
        "DOUBT_LIMIT",
        "WIDENED",
    ),
    *(f"{name}{joint}" for name in ("COUNT", "SIGN", "EFFORT", "BASE", "PULL") for joint in (1, 2, 3)),
}
ROW, CHARACTER, MARGIN = 70.0, 16.0, 100.0
"""The sizes of a port and of a letter of its name in 4diac IDE's coordinates, and room around a block, generously."""

files = pytest.mark.parametrize("path", [*TYPES, SYSTEM], ids=lambda path: path.name)
types = pytest.mark.parametrize("path", TYPES, ids=lambda path: path.stem)


def basic_types() -> list[model.BasicFBType]:
    library = Library([FOLDER])
    found = [library.find(path.stem) for path in TYPES]
    return [kind for kind in found if isinstance(kind, model.BasicFBType)]


charts = pytest.mark.parametrize("kind", basic_types(), ids=lambda kind: kind.header.name)


def root(path: Path) -> ElementTree.Element:
    return ElementTree.fromstring(path.read_bytes())


@files
def test_identification_and_version(path: Path) -> None:
    identification, version = root(path).find("Identification"), root(path).find("VersionInfo")
    assert identification is not None
    assert identification.get("Standard") == "61499-2"
    assert version is not None
    assert version.get("Version")
    assert root(path).get("Name") == path.stem


@files
def test_everything_has_a_comment(path: Path) -> None:
    tags = ("Event", "VarDeclaration", "FB", "Algorithm", "ECState", "Application", "Device", "Resource")
    named = [root(path), *(element for tag in tags for element in root(path).iter(tag))]
    assert [element.get("Name") for element in named if not element.get("Comment")] == []


@types
def test_numbers_have_units(path: Path) -> None:
    for variable in root(path).iter("VarDeclaration"):
        if variable.get("Type") == "LREAL" and variable.get("Name") not in PURE_NUMBERS:
            assert UNIT.search(variable.get("Comment", "")), f"{variable.get('Name')}: {variable.get('Comment')}"


@dataclass(frozen=True)
class Box:
    """Where a block is drawn."""

    name: str
    left: float
    top: float
    width: float
    height: float

    def overlaps(self, other: "Box") -> bool:
        return not (
            self.left + self.width <= other.left
            or other.left + other.width <= self.left
            or self.top + self.height <= other.top
            or other.top + other.height <= self.top
        )


def boxes(network: model.FBNetwork, library: Library) -> list[Box]:
    made = []
    for block in network.blocks:
        ports = library.find(block.type_name).interface
        rows = max(len(ports.event_inputs), len(ports.event_outputs)) + max(len(ports.inputs), len(ports.outputs)) + 2
        letters = max(map(len, ports.names()))
        width = max(2 * letters, len(block.type_name)) * CHARACTER + MARGIN
        made.append(Box(block.name, block.x, block.y, width, rows * ROW + MARGIN))
    return made


def networks() -> Iterator[tuple[str, model.FBNetwork]]:
    library = Library([FOLDER])
    system = library.load_system(SYSTEM)
    for application in system.applications:
        yield application.name, application.network
    for device in system.devices:
        for resource in device.resources:
            yield resource.name, resource.network
    for path in TYPES:
        kind = library.find(path.stem)
        if isinstance(kind, model.CompositeFBType):
            yield path.stem, kind.network


@pytest.mark.parametrize("network", [pytest.param(network, id=name) for name, network in networks()])
def test_blocks_do_not_overlap(network: model.FBNetwork) -> None:
    overlapping = [
        (a.name, b.name) for a, b in itertools.combinations(boxes(network, Library([FOLDER])), 2) if a.overlaps(b)
    ]
    assert overlapping == []


@charts
def test_states_and_conditions_stand_apart(kind: model.BasicFBType) -> None:
    for a, b in itertools.combinations(kind.states, 2):
        assert math.hypot(a.x - b.x, a.y - b.y) > 500, (a.name, b.name)
    for s, t in itertools.combinations(kind.transitions, 2):
        assert math.hypot(s.x - t.x, s.y - t.y) > 60, (s, t)


@charts
def test_charts_use_all_they_declare(kind: model.BasicFBType) -> None:
    used = {action.algorithm for state in kind.states for action in state.actions} - {""}
    assert used == {algorithm.name for algorithm in kind.algorithms}
    issued = {action.output for state in kind.states for action in state.actions} - {""}
    assert issued == {event.name for event in kind.interface.event_outputs}
    reached = {kind.states[0].name}
    while new := {t.destination for t in kind.transitions if t.source in reached} - reached:
        reached |= new
    assert reached == {state.name for state in kind.states}


def test_the_resource_shows_the_whole_application() -> None:
    system = Library([FOLDER]).load_system(SYSTEM)
    (application,), (device,) = system.applications, system.devices
    (resource,) = device.resources
    here = {block.name: (block.type_name, block.x, block.y) for block in application.network.blocks}
    there = {block.name: (block.type_name, block.x, block.y) for block in resource.network.blocks}
    assert here == there
    assert {m.source: m.destination for m in system.mappings} == {
        f"{application.name}.{name}": f"{device.name}.{resource.name}.{name}" for name in here
    }


def test_ports_of_the_twin() -> None:
    ports = {}
    for path in [*TYPES, SYSTEM]:
        networks_of_file = root(path).iter("SubAppNetwork") if path == SYSTEM else [root(path)]
        for network in networks_of_file:
            for block in network.iter("FB"):
                for parameter in block.iter("Parameter"):
                    if parameter.get("Name") == "ID":
                        ports[parameter.get("Value", "").strip('"')] = block.get("Type")
    assert ports == {
        "localhost:61500": "SERVER_5_6",
        "localhost:61501": "SERVER_0_1",
        "localhost:61502": "SERVER_7_0",
        "localhost:61503": "SERVER_8_0",
        "localhost:61504": "SERVER_0_10",
        "localhost:61505": "SERVER_0_21",
        "localhost:61506": "SERVER_1_3",
    }
