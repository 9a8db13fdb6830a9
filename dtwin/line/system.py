"""The control of a line as a system of IEC 61499: one application, with a device for each station, vehicle group and
zone.

The application knows no devices: its connections between blocks on different ones are made of PUBLISH and SUBSCRIBE
blocks when it is loaded, and are plain connections where all is mapped to one resource. Plant and twins are clients
of its SERVER blocks.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Final

from dtwin.arm.sorting import read_sorting
from dtwin.line.chain.cell import arm_cell
from dtwin.line.line import (
    CYCLE,
    MOST_OPERATIONS,
    MOST_STATIONS,
    Line,
    StationPlan,
    VehiclePlan,
    ZonePlan,
    block_name,
)
from dtwin.line.track import MOST_NODES
from dtwin.run.cell_file import cell_of
from dtwin.task import DEFAULT_TASK, Task
from iec61499.mapping import literal_of
from iec61499.model import (
    ApplicationDeclaration,
    Block,
    Connection,
    DeviceDeclaration,
    FBNetwork,
    Parameter,
    ResourceDeclaration,
    System,
    TypeHeader,
    Version,
)
from iec61499.model import (
    Mapping as Mapped,
)

APPLICATION: Final = "LINE"
RESOURCE: Final = "EMB_RES"
_PLANT: Final = "_PLANT"
_FIRST_PORT: Final = 61600
"""Port of the first SERVER block; each further one has the next."""
_TRACKED: Final = (
    *("TAG", "OCC", "CLOSED"),
    *("PHASE", "AT", "LOAD", "NEXT", "ACTIVE", "IDLE"),
    *("KNOWN", "ROOM_LEFT"),
)
"""What BOX_TRACKING tells ORDER_DISPATCH: of slots, of vehicles, of the zone."""
_WIDTH, _HEIGHT = 2600.0, 2200.0
"""Room that a block is given in the drawing."""

VERSION: Final = Version("1.0", "dtwin", "2026-11-27", "dtwin", "First version")


@cache
def plant_of(name: str) -> str:
    """Name of the SERVER block at which the plant of a zone, station or vehicle is a client."""
    return f"{block_name(name)}{_PLANT}"


def setup_of(zone: str) -> str:
    """Name of the SERVER block that takes the set-up of a zone."""
    return f"{block_name(zone)}_SETUP"


def task_of(station: StationPlan) -> Task:
    """What the cell of a station has to do."""
    return DEFAULT_TASK if station.cell_file is None else cell_of(station.cell_file).task


def places_of(station: StationPlan) -> tuple[str, ...]:
    """The names of the places of the cell of a station, by whose numbers its blocks are told them."""
    cell = arm_cell(station)
    if cell is None:
        return task_of(station).colours
    return () if cell.sort is None else tuple(read_sorting(cell.sort).places)


@dataclass
class _Drawing:
    """An application that is being drawn, and where its blocks run."""

    blocks: list[Block] = field(default_factory=list)
    events: list[Connection] = field(default_factory=list)
    data: list[Connection] = field(default_factory=list)
    places: dict[str, str] = field(default_factory=dict)
    ports: int = 0

    def block(self, device: str, name: str, kind: str, comment: str, **values: str) -> str:
        row = sum(place == device for place in self.places.values())
        column = list(dict.fromkeys([*self.places.values(), device])).index(device)
        parameters = tuple(Parameter(key, value) for key, value in values.items())
        self.blocks.append(Block(name, kind, parameters, 200.0 + _WIDTH * row, 200.0 + _HEIGHT * column, comment))
        self.places[name] = device
        return name

    def server(self, device: str, name: str, sends: int, receives: int, comment: str) -> str:
        identity = f"'localhost:{_FIRST_PORT + self.ports}'"
        self.ports += 1
        return self.block(device, name, f"SERVER_{sends}_{receives}", comment, QI="TRUE", ID=identity)

    def event(self, source: str, *destinations: str) -> None:
        self.events += (Connection(source, destination) for destination in destinations)

    def wires(self, source: str, destination: str, names: Mapping[str, str]) -> None:
        """Data connections from outputs of a block to inputs of another one, by their names."""
        self.data += (Connection(f"{source}.{out}", f"{destination}.{into}") for out, into in names.items())


def system(line: Line) -> System:
    """The control of a line."""
    drawing = _Drawing()
    for zone in line.zones:
        _draw_zone(drawing, line, zone)
    devices = tuple(
        DeviceDeclaration(
            name,
            "FORTE_PC",
            (_resource([block for block, place in drawing.places.items() if place == name]),),
            (Parameter("MGR_ID", f"'localhost:{_FIRST_PORT - 1 - number}'"),),
            comment,
        )
        for number, (name, comment) in enumerate(_devices(line).items())
    )
    network = FBNetwork(tuple(drawing.blocks), (), tuple(drawing.events), tuple(drawing.data))
    application = ApplicationDeclaration(APPLICATION, network, f"Control of the line {line.name}")
    mappings = tuple(
        Mapped(f"{APPLICATION}.{block}", f"{device}.{RESOURCE}.{block}") for block, device in drawing.places.items()
    )
    header = TypeHeader(
        block_name(line.name),
        comment=f"Control of the line {line.name}",
        standard="61499-2",
        versions=(VERSION,),
    )
    return System(header, (application,), devices, mappings)


def on_one_resource(whole: System) -> System:
    """The same application on one device alone."""
    blocks = [block.name for application in whole.applications for block in application.network.blocks]
    device = DeviceDeclaration("ALL", "FORTE_PC", (_resource(blocks),))
    mappings = tuple(replace(each, destination=f"ALL.{RESOURCE}") for each in whole.mappings)
    return replace(whole, devices=(device,), mappings=mappings)


def _resource(blocks: list[str]) -> ResourceDeclaration:
    """A resource that initialises those of its blocks at which a plant is a client; these initialise the others."""
    starts = tuple(Connection("START.COLD", f"{block}.INIT") for block in blocks if block.endswith(_PLANT))
    return ResourceDeclaration(RESOURCE, RESOURCE, FBNetwork((), (), starts), comment="Its blocks")


def device_of(station: str) -> str:
    """Name of the device of a station."""
    return f"STATION_{block_name(station)}"


def _devices(line: Line) -> dict[str, str]:
    found = {}
    for zone in line.zones:
        found[f"ZONE_{block_name(zone.name)}"] = f"Control of zone {zone.name}"
        found[f"VEHICLES_{block_name(zone.name)}"] = f"Control of the vehicles of zone {zone.name}"
        found |= {device_of(station.name): f"Control of station {station.name}" for station in zone.stations}
    return found


@dataclass(frozen=True, slots=True)
class _ZoneBlocks:
    """Names of the device of a zone and of its blocks."""

    device: str
    plant: str
    tracking: str
    dispatch: str
    router: str


@dataclass(frozen=True, slots=True)
class _Message:
    """A message to another device.

    Attributes:
        event: the event output that sends it.
        number: the output that has its number.
        values: the outputs with what it says, DINT; at most six.
    """

    event: str
    number: str
    values: tuple[str, ...]


def _receive(drawing: _Drawing, device: str, name: str, plant: str, message: _Message) -> str:
    """Draws the block that drops what is old of messages to a device; its name.

    Args:
        drawing: the application.
        device: the device.
        name: what the block is called.
        plant: the SERVER block at which the plant asks this device, whose last value is the number of the sample.
        message: the message.
    """
    newest = drawing.block(device, name, "NEWEST_MESSAGE", f"Drops what is old of what {message.event} tells")
    drawing.event(f"{plant}.INITO", f"{newest}.INIT")
    drawing.event(f"{plant}.IND", f"{newest}.OWN")
    drawing.event(message.event, f"{newest}.REQ")
    sources = {message.number: "NUMBER"} | {source: f"IN{k}" for k, source in enumerate(message.values, 1)}
    drawing.data += (Connection(source, f"{newest}.{into}") for source, into in sources.items())
    return newest


def _draw_zone(drawing: _Drawing, line: Line, zone: ZonePlan) -> None:
    number, name, track = line.zones.index(zone), block_name(zone.name), zone.track
    device = f"ZONE_{name}"
    plant = drawing.server(
        device, plant_of(zone.name), 2, 3, "The ends of the zone: next box and room in, orders out"
    )
    setup = drawing.server(device, setup_of(zone.name), 2, MOST_OPERATIONS, "Which station does which operation")
    nodes = {f"NODE{k}": literal_of(track.number(s.node)) for k, s in enumerate(zone.stations, 1)}
    nodes |= {f"NODE{k}": "0" for k in range(len(zone.stations) + 1, MOST_STATIONS + 1)}
    vehicles = literal_of(len(zone.vehicles))
    tracking = drawing.block(device, f"{name}_TRACKING", "BOX_TRACKING", "Which box is where", VEHICLES=vehicles)
    dispatch = drawing.block(
        device,
        f"{name}_DISPATCH",
        "ORDER_DISPATCH",
        "Which vehicle brings which box where",
        ENTRY_NODE=literal_of(track.number(line.entry(number))),
        EXIT_NODE=literal_of(track.number(line.exit(number))),
        **nodes,
        VEHICLES=vehicles,
        OPERATIONS=literal_of(len(line.operations)),
    )
    router = drawing.block(
        device,
        f"{name}_ROUTER",
        "TRACK_ROUTER",
        "Who may drive where",
        **{key: literal_of(value) for key, value in router_inputs(line, number).items()},
    )
    drawing.event(f"{plant}.INITO", f"{setup}.INIT")
    drawing.event(f"{setup}.INITO", f"{tracking}.INIT")
    drawing.event(f"{tracking}.INITO", f"{dispatch}.INIT")
    drawing.event(f"{dispatch}.INITO", f"{router}.INIT")
    drawing.event(f"{plant}.IND", f"{tracking}.REQ")
    drawing.event(f"{tracking}.CNF", f"{dispatch}.REQ")
    drawing.event(f"{dispatch}.CNF", f"{plant}.RSP")
    drawing.event(f"{setup}.IND", f"{tracking}.SETUP")
    drawing.event(f"{tracking}.SETUPO", f"{dispatch}.SETUP")
    drawing.event(f"{dispatch}.SETUPO", f"{setup}.RSP")
    drawing.wires(plant, tracking, {"RD_1": "ENTRY", "RD_2": "ROOM"})
    drawing.wires(plant, dispatch, {"RD_3": "SAMPLE"})
    drawing.wires(tracking, dispatch, {name: name for name in _TRACKED})
    drawing.wires(dispatch, tracking, {"JOBS": "JOB", "TAKES": "TAKE", "BRINGS": "BRING"})
    drawing.wires(dispatch, plant, {"ORDERS": "SD_1", "NUMBER": "SD_2"})
    drawing.wires(setup, dispatch, {f"RD_{k}": f"S{k}" for k in range(1, MOST_OPERATIONS + 1)})
    drawing.wires(dispatch, setup, {"SETUPS": "SD_1", "NUMBER": "SD_2"})
    blocks = _ZoneBlocks(device, plant, tracking, dispatch, router)
    for k, vehicle in enumerate(zone.vehicles, 1):
        _draw_vehicle(drawing, zone, k, vehicle, blocks)
    for k, station in enumerate(zone.stations, 1):
        _draw_station(drawing, line, k, station, blocks)


def _draw_vehicle(drawing: _Drawing, zone: ZonePlan, k: int, vehicle: VehiclePlan, blocks: _ZoneBlocks) -> None:
    device, name = f"VEHICLES_{block_name(zone.name)}", block_name(vehicle.name)
    plant = drawing.server(device, plant_of(vehicle.name), 4, 6, f"Vehicle {vehicle.name}: where it is; what it does")
    execution = drawing.block(
        device,
        f"{name}_EXECUTION",
        "ORDER_EXECUTION",
        f"Orders of vehicle {vehicle.name}",
        HOME=literal_of(zone.track.number(vehicle.home)),
        PATIENCE=literal_of(round(vehicle.patience / CYCLE)),
    )
    drawing.event(f"{plant}.INITO", f"{execution}.INIT")
    drawing.event(f"{plant}.IND", f"{execution}.REQ")
    drawing.wires(plant, execution, {"RD_1": "AT", "RD_2": "STANDING", "RD_3": "LOAD", "RD_4": "BATTERY"})
    drawing.wires(execution, plant, {"ACTION": "SD_2", "SLOT": "SD_3"})
    does = (f"{execution}.{name}" for name in ("GOAL", "PHASE", "DONE"))
    told = (f"{plant}.RD_1", f"{plant}.RD_5", f"{plant}.RD_3", *does)
    message = _Message(f"{execution}.CNF", f"{plant}.RD_6", told)
    state = _receive(drawing, blocks.device, f"{name}_STATE", blocks.plant, message)
    drawing.event(f"{state}.CNF", f"{blocks.tracking}.VEHICLE{k}", f"{blocks.router}.REQ{k}")
    drawing.wires(state, blocks.tracking, {f"OUT{n}": f"{to}{k}" for n, to in ((1, "AT"), (3, "LOAD"))})
    drawing.wires(state, blocks.tracking, {f"OUT{n}": f"{to}{k}" for n, to in ((5, "PHASE"), (6, "DONE"))})
    drawing.wires(state, blocks.router, {f"OUT{n}": f"{to}{k}" for n, to in ((1, "AT"), (2, "BASE_END"))})
    drawing.wires(state, blocks.router, {"OUT4": f"GOAL{k}"})
    drawing.event(f"{blocks.router}.CNF{k}", f"{plant}.RSP")
    drawing.event(f"{state}.EARLY", f"{plant}.RSP")  # nothing is given to it, but it need not wait for an answer
    drawing.wires(blocks.router, plant, {f"NEXT{k}": "SD_1"})
    drawing.wires(state, plant, {"NEWEST": "SD_4"})
    names = ("JOB", "TAKE_NODE", "TAKE_SLOT", "BRING_NODE", "BRING_SLOT")
    ordered = tuple(f"{blocks.dispatch}.{n}{k}" for n in names)
    message = _Message(f"{blocks.dispatch}.ORDER{k}", f"{blocks.dispatch}.ORDER_NUMBER{k}", ordered)
    order = _receive(drawing, device, f"{name}_ORDER", plant, message)
    drawing.event(f"{order}.CNF", f"{execution}.ORDER")
    drawing.wires(order, execution, {f"OUT{n}": to for n, to in enumerate(names, 1)})


def _draw_station(drawing: _Drawing, line: Line, k: int, station: StationPlan, blocks: _ZoneBlocks) -> None:
    device, name, colours = device_of(station.name), block_name(station.name), places_of(station)
    plant = drawing.server(
        device, plant_of(station.name), 1, 6, f"Station {station.name}: tags, arm and stop in; what is offered out"
    )
    places = [
        colours.index(operation.place) + 1 if operation.name in station.operations else 0
        for operation in line.operations
    ]
    places += [0] * (MOST_OPERATIONS - len(places))
    setup = drawing.block(
        device,
        f"{name}_SETUP",
        "STATION_SETUP",
        f"What the arm of station {station.name} is offered",
        **{f"PLACE{number}": literal_of(place) for number, place in enumerate(places, 1)},
    )
    drawing.event(f"{plant}.INITO", f"{setup}.INIT")
    drawing.event(f"{plant}.IND", f"{setup}.REQ")
    drawing.event(f"{setup}.CNF", f"{plant}.RSP")
    drawing.wires(plant, setup, {"RD_1": "BOX_IN", "RD_3": "BOX_OUT", "RD_4": "ARM", "RD_5": "STOP"})
    drawing.wires(setup, plant, {"OFFER": "SD_1"})
    told = (*(f"{plant}.RD_{n}" for n in (1, 2, 3)), f"{setup}.STATE")
    message = _Message(f"{setup}.CNF", f"{plant}.RD_6", told)
    state = _receive(drawing, blocks.device, f"{name}_STATE", blocks.plant, message)
    drawing.event(f"{state}.CNF", f"{blocks.tracking}.STATION{k}")
    names = ("IN", "WORK", "OUT", "STATE")
    drawing.wires(state, blocks.tracking, {f"OUT{n}": f"{to}{k}" for n, to in enumerate(names, 1)})
    message = _Message(
        f"{blocks.dispatch}.ENABLE", f"{blocks.dispatch}.ENABLE_NUMBER", (f"{blocks.dispatch}.MASK{k}",)
    )
    enabled = _receive(drawing, device, f"{name}_ENABLED", plant, message)
    drawing.event(f"{enabled}.CNF", f"{setup}.SETUP")
    drawing.wires(enabled, setup, {"OUT1": "MASK"})


def router_inputs(line: Line, zone: int) -> dict[str, Any]:
    """Values for the inputs of TRACK_ROUTER of a zone."""
    plan = line.zones[zone]
    track = plan.track
    docks = {line.entry(zone), line.exit(zone), *(s.node for s in plan.stations), *(v.home for v in plan.vehicles)}
    ends = [(track.number(s.start), track.number(s.end)) for s in track.segments]
    return track_inputs(
        len(track.nodes), ends, {track.number(dock) for dock in docks}, [track.number(v.home) for v in plan.vehicles]
    )


def track_inputs(
    nodes: int, ends: Sequence[tuple[int, int]], docks: set[int], homes: Sequence[int]
) -> dict[str, Any]:
    """Values for the inputs of TRACK_ROUTER.

    Args:
        nodes: number of nodes, which are numbered from 1.
        ends: nodes at which each segment begins and ends.
        docks: nodes that no route passes.
        homes: docks at which the vehicles begin.
    """
    return {
        "NODES": nodes,
        "SEGMENTS": len(ends),
        "VEHICLES": len(homes),
        "FROM_NODE": _filled([start for start, _ in ends], 2 * MOST_NODES),
        "INTO_NODE": _filled([stop for _, stop in ends], 2 * MOST_NODES),
        "DOCK": [node in docks for node in range(1, MOST_NODES + 1)],
        "HOME": _filled(homes, 8),
    }


def _filled(values: Sequence[int], size: int) -> list[int]:
    return [*values, *[0] * (size - len(values))]
