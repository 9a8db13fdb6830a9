"""Lines as files: `lines/*.toml`, or any other TOML file of the same form; docs/line.md explains every key."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import msgspec

from dtwin.errors import DtwinError, ModelError, ParameterError, choices
from dtwin.line.line import BoxClass, Buffer, Line, Operation, Source, StationPlan, VehiclePlan, ZonePlan
from dtwin.line.stations import checked_places
from dtwin.line.track import Point, Segment, Track
from dtwin.parameters import ROOT
from dtwin.run.cell_file import is_file as is_cell_file

FOLDER: Final = ROOT / "lines"
"""Folder of the named lines."""
DEFAULT_NAME: Final = "default"
_SUFFIX: Final = ".toml"
_LONGEST: Final = 1 << 20
"""Largest file that is read, bytes."""
T = TypeVar("T")
Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
Share = Annotated[float, msgspec.Meta(ge=0.0, le=100.0)]
Patience = Annotated[float, msgspec.Meta(ge=0.0, le=1e6)]
Count = Annotated[int, msgspec.Meta(ge=1, le=1000)]
Seed = Annotated[int, msgspec.Meta(ge=0, le=2**62)]


class _Operation(msgspec.Struct, forbid_unknown_fields=True):
    place: str


class _Source(msgspec.Struct, forbid_unknown_fields=True):
    node: str
    every: Positive
    mass: tuple[Positive, Positive] | None = None
    masses: Annotated[list[Positive], msgspec.Meta(max_length=1000)] = []
    classes: dict[str, Positive] = {}


class _Sink(msgspec.Struct, forbid_unknown_fields=True):
    node: str


class _Buffer(msgspec.Struct, forbid_unknown_fields=True):
    exit: str
    entry: str
    capacity: Count


class _Station(msgspec.Struct, forbid_unknown_fields=True):
    node: str
    operations: list[str]
    cell: str | None = None
    machine: str | None = None
    seed: Seed = 0
    faults: list[str] = []


class _Vehicle(msgspec.Struct, forbid_unknown_fields=True):
    home: str
    speed: Positive = 1.0
    acceleration: Positive = 0.5
    handling: Positive = 2.0
    consumption: Share = 0.05
    idle: Share = 0.1
    charging: Share = 20.0
    patience: Patience = 10.0
    manufacturer: str = ""


class _Zone(msgspec.Struct, forbid_unknown_fields=True):
    nodes: dict[str, Point]
    segments: list[str]
    stations: dict[str, _Station]
    vehicles: dict[str, _Vehicle]


class _File(msgspec.Struct, forbid_unknown_fields=True):
    operations: dict[str, _Operation]
    source: _Source
    sink: _Sink
    zones: dict[str, _Zone]
    assignment: dict[str, str]
    buffers: list[_Buffer] = []
    seed: Seed = 0


def names() -> list[str]:
    """Names of the lines in `lines/`."""
    return sorted(path.stem for path in FOLDER.glob(f"*{_SUFFIX}"))


def line_of(text: str) -> Line:
    """The line that a name or a file (*.toml) stands for.

    Raises:
        ModelError: there is no such line, or its file cannot be read or holds what no line has.
        ParameterError: a value is out of range, or the parts do not fit together.
    """
    if text.endswith(_SUFFIX):
        return load(Path(text))
    if text not in names():
        raise ModelError(f"line {text!r}: expected a file (*{_SUFFIX}) or {choices(names())}")
    return load(FOLDER / f"{text}{_SUFFIX}")


def load(path: Path) -> Line:
    """Reads a line.

    Raises:
        ModelError: the file cannot be read, or holds what no line has; names the file and the key.
        ParameterError: a value is out of range, or the parts do not fit together.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_LONGEST + 1)
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror}") from None
    if len(content) > _LONGEST:
        raise ModelError(f"{path}: expected a line of at most {_LONGEST} bytes")
    try:
        found = msgspec.toml.decode(content, type=_File)
    except msgspec.ValidationError as error:
        text, _, key = str(error).partition(" - at `$")
        where = _where(msgspec.toml.decode(content), key.strip("`"), str(error))
        where = f"{where}: " if where else ""
        raise ModelError(
            f"{path}: {where}{text[:1].lower()}{text[1:].replace('`', '')}{_hint(text, where)}"
        ) from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise ModelError(f"{path}: expected a line: {error}") from None
    try:
        return _line(path, found)
    except DtwinError as error:
        kind = ModelError if isinstance(error, ModelError) else ParameterError
        raise kind(f"{path}: {error}") from None


def _where(content: Any, key: str, error: str) -> str:
    """The place in a file that is wrong, where msgspec tells `[...]` for the names in tables.

    Args:
        content: what the file says.
        key: the place as msgspec tells it, such as `.zones[...].vehicles[...].speed`.
        error: the error that it has told: the first names with which it comes again are the ones.
    """
    parts = key.removeprefix(".").split("[...]")
    found = parts[0]
    for part in parts[1:]:
        table = _inner(content, found)
        name = next((each for each in table or () if _same_error(content, found, each, error)), None)
        if name is None:
            return key.removeprefix(".").replace("[...]", ".*")
        _keep(content, found, name)
        found += f".{name}{part}"
    return found


def _inner(content: Any, key: str) -> Any:
    """What stands at a place of a file, such as zones.a.vehicles."""
    for part in filter(None, key.split(".")):
        content = content.get(part) if isinstance(content, dict) else None
    return content


def _keep(content: Any, key: str, name: str) -> None:
    """Leaves one name alone in a table at a place of a file."""
    table = _inner(content, key)
    for each in [other for other in table if other != name]:
        del table[each]


def _same_error(content: Any, key: str, name: str, error: str) -> bool:
    """Whether a file with one name alone in a table has the same error."""
    tried = copy.deepcopy(content)
    _keep(tried, key, name)
    try:
        msgspec.convert(tried, _File)
    except msgspec.ValidationError as again:
        return str(again) == error
    return False


def _hint(text: str, where: str) -> str:
    """The keys that may be where one is unknown, at a place in the file."""
    if "unknown field" not in text:
        return ""
    kinds = {"stations": _Station, "vehicles": _Vehicle, "zones": _Zone, "operations": _Operation}
    kinds |= {"source": _Source, "sink": _Sink, "buffers": _Buffer}
    kind = next((kind for name, kind in kinds.items() if name in where), _File)
    return f": expected {choices(kind.__struct_fields__)}"


def _line(path: Path, found: _File) -> Line:
    line = Line(
        path.stem,
        tuple(Operation(name, operation.place) for name, operation in found.operations.items()),
        tuple(_zone(name, zone, path.parent) for name, zone in found.zones.items()),
        _source(found.source),
        tuple(Buffer(buffer.exit, buffer.entry, buffer.capacity) for buffer in found.buffers),
        found.sink.node,
        found.assignment,
        found.seed,
    )
    for station in line.stations:
        check_station(line, station)
    return line


def _source(found: _Source) -> Source:
    """The source, whose boxes have listed masses, or ones between two."""
    if found.masses and found.mass is not None:
        raise ParameterError("source.masses: expected these or mass, not both")
    lightest, heaviest = sorted(found.mass or (0.190, 0.210))
    if found.masses:
        lightest, heaviest = min(found.masses), max(found.masses)
    classes = sorted((BoxClass(*each) for each in found.classes.items()), key=lambda each: -each.heaviest)
    return Source(found.node, found.every, lightest, heaviest, tuple(found.masses), tuple(classes))


def check_station(line: Line, station: StationPlan) -> None:
    """Checks that a station can be one of a line: its cell, and the places of its operations there.

    Raises:
        DtwinError: it cannot; names station and key.
    """
    where = f"zones.{line.zones[line.zone_of(station.name)].name}.stations.{station.name}"
    places = {operation.name: operation.place for operation in line.operations}
    try:
        known = checked_places(station, line.source.heaviest)
    except ParameterError as error:
        raise ParameterError(f"{where}: {error}") from None
    for name in station.operations:
        if places[name] not in known:
            raise ParameterError(
                f"operations.{name}.place, for {where}: expected {choices(known)}, got {places[name]!r}"
            )


def _zone(name: str, zone: _Zone, folder: Path) -> ZonePlan:
    try:
        track = Track(zone.nodes, tuple(s for text in zone.segments for s in _segments(text)))
    except ParameterError as error:
        raise ParameterError(f"zones.{name}: {error}") from None
    return ZonePlan(
        name,
        track,
        tuple(_station(key, station, folder) for key, station in zone.stations.items()),
        tuple(
            VehiclePlan(key, *(getattr(vehicle, part) for part in vehicle.__struct_fields__))
            for key, vehicle in zone.vehicles.items()
        ),
    )


def _station(name: str, found: _Station, folder: Path) -> StationPlan:
    cell, machine = (_beside(text, folder) for text in (found.cell, found.machine))
    return StationPlan(name, found.node, tuple(found.operations), cell, machine, found.seed, tuple(found.faults))


def _beside(text: str | None, folder: Path) -> str | None:
    return str((folder / text).resolve()) if text is not None and is_cell_file(text) else text


def _segments(text: str) -> list[Segment]:
    """The segments of a chain of nodes: A>B>C is driven one way, A<>B both."""
    found: list[Segment] = []
    rest, both = text.replace("<>", "\0").replace(">", "\1"), {"\0": True, "\1": False}
    parts, signs = [], []
    for character in rest:
        if character in both:
            signs.append(both[character])
            parts.append("")
        elif not parts:
            parts.append(character)
        else:
            parts[-1] += character
    nodes = [part.strip() for part in parts]
    if len(nodes) < 2 or not all(nodes):
        raise ParameterError(f"segments: expected nodes with > or <> between them, such as A>B<>C, got {text!r}")
    for start, end, two_way in zip(nodes, nodes[1:], signs, strict=False):
        found.append(Segment(start, end))
        if two_way:
            found.append(Segment(end, start))
    return found


def shown(line: Line) -> Mapping[str, Any]:
    """What a line is, in few words, for people."""
    return {
        "zones": len(line.zones),
        "stations": len(line.stations),
        "vehicles": sum(len(zone.vehicles) for zone in line.zones),
        "operations": [operation.name for operation in line.operations],
    }
