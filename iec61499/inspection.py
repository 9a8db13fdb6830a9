"""Finds what is wrong with function-block files: schema, types, connections, Structured Text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from iec61499 import model
from iec61499.departures.table import departures
from iec61499.errors import CommunicationError, FunctionBlockError
from iec61499.files.block_types import read_type
from iec61499.files.systems import read_system
from iec61499.library import Library
from iec61499.management.bootfile import load_boot_file
from iec61499.mapping import resource_network, wrong_mappings
from iec61499.net.protocols import check_id
from iec61499.opening import opened
from iec61499.runtime.checker import BlockChecker
from iec61499.runtime.compile import has_no_service
from iec61499.runtime.inner_blocks import add_reactions
from iec61499.runtime.linking.generic_ports import unconnected
from iec61499.runtime.linking.linker import link
from iec61499.runtime.linking.netlist import Finder, Netlist, Node
from iec61499.standard.services import COMMUNICATION

_ABSENT: Final = "it cannot run, or answers with QO = FALSE"
_NETWORKED: Final = {"PUBL": "PUBLISH", "SUBL": "SUBSCRIBE"}
MAXIMUM_PROBLEMS: Final = 100
"""Most mistakes of one network that are looked for."""
SUFFIXES: Final = (".fbt", ".fct", ".sub", ".sys", ".fboot")


class Remark(FunctionBlockError):
    """What is right but may not be meant.

    Attributes:
        rule: the name of the rule that it offends.
    """

    def __init__(self, rule: str, message: str, file: str = "", line: int = 0) -> None:
        super().__init__(message, file, line)
        self.rule = rule


@dataclass(frozen=True, slots=True)
class Findings:
    """What was found in a file, in the order of its lines as far as they are known; each once.

    Attributes:
        problems: what is wrong.
        departures: blocks that may compute something else on 4diac FORTE.
        remarks: blocks and connections of a system that run nowhere, and services that this device does not have.
    """

    problems: tuple[FunctionBlockError, ...]
    departures: tuple[FunctionBlockError, ...]
    remarks: tuple[Remark, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """The remarks as lines."""
        return tuple(map(str, self.remarks))


def inspect(file: Path, library: Library) -> Findings:
    """Looks for what is wrong with a file, and for what differs on 4diac FORTE.

    Args:
        file: a block type (.fbt, .sub), system (.sys) or boot file (.fboot).
        library: finds the block types that the file uses.
    """
    problems = _Problems()
    with problems.noted():
        suffix = file.suffix.lower()
        if suffix in (".fbt", ".fct", ".sub"):
            _inspect_type(file, library, problems)
        elif suffix == ".sys":
            _inspect_system(read_system(file, library), library, problems)
        elif suffix == ".fboot":
            load_boot_file(file)
        else:
            raise FunctionBlockError("expected a file that ends in .fbt, .sub, .sys or .fboot", str(file))
    return Findings(_in_order(problems.found), _in_order(problems.departures), tuple(problems.remarks.values()))


def _in_order(found: dict[str, FunctionBlockError]) -> tuple[FunctionBlockError, ...]:
    return tuple(sorted(found.values(), key=lambda error: (error.file, error.line, error.column)))


class _Problems:
    def __init__(self) -> None:
        self.found: dict[str, FunctionBlockError] = {}
        self.departures: dict[str, FunctionBlockError] = {}
        self.remarks: dict[str, Remark] = {}

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Takes an error as a problem and goes on behind the block."""
        try:
            yield
        except FunctionBlockError as error:
            self.note(error)

    def note(self, error: FunctionBlockError) -> None:
        self.found.setdefault(str(error), error)

    def remark(self, remark: Remark) -> None:
        self.remarks.setdefault(str(remark), remark)


def _inspect_type(file: Path, library: Library, problems: _Problems) -> None:
    found = read_type(file, library)
    header = found.header
    if header.name != file.stem:
        message = f"holds the type {header.name}: expected {file.stem}, as the file's name says"
        problems.found[message] = FunctionBlockError(message, header.file, header.line)
    for remark in _case_remarks(found):
        problems.remark(remark)
    if isinstance(found, model.BasicFBType | model.SimpleFBType):
        _inspect_text(found, problems)
    elif isinstance(found, model.ServiceInterfaceFBType):
        _inspect_service(found, library, problems)
    else:

        def find(name: str, user: str, line: int) -> model.LibraryElement:
            return found if name == header.name else library.find(name, user, line)

        alone = model.FBNetwork((model.Block(header.name, header.name, line=header.line),), file=header.file)
        _inspect_network(alone, find, problems)


def _inspect_service(own: model.LibraryElement, library: Library, problems: _Problems) -> None:
    """Remarks that a block has an interface and no behaviour here; the type itself is right."""
    with problems.noted():
        found = library.find(own.header.name)
        if isinstance(found, model.ServiceInterfaceFBType) and has_no_service(found):
            message = f"{own.header.name} is an interface only, a service that this device does not have: {_ABSENT}"
            problems.remark(Remark("no-such-service", message, own.header.file, own.header.line))


def _protocol_problem(node: Node, connected: set[str]) -> str | None:
    """Why the ID of a communication block leads nowhere here; None for other blocks, and where nothing is known."""
    parameter = node.parameters.get("ID")
    kind = COMMUNICATION.fullmatch(node.type.header.name) if node.type is not None else None
    if kind is None or parameter is None or "ID" in connected:
        return None
    text = parameter.value.strip().strip("'\"")
    if text.startswith("loc[") or (kind[4] in ("PUBL", "SUBL") and "[" not in text):
        return None
    inputs = sum(variable.name.startswith("SD_") for variable in node.interface.inputs)
    outputs = sum(variable.name.startswith("RD_") for variable in node.interface.outputs)
    try:
        check_id(text, kind[1] or _NETWORKED.get(kind[4], kind[4]), inputs, outputs)
    except CommunicationError as error:
        return f"ID {text}: {error}"
    return None


def _case_remarks(found: model.LibraryElement) -> Iterator[Remark]:
    """Events and data of a type whose names differ only in case, which IEC 61131-3 takes for one name."""
    interface = found.interface
    events = {event.name.upper(): event for event in (*interface.event_inputs, *interface.event_outputs)}
    for variable in (*interface.inputs, *interface.outputs):
        event = events.get(variable.name.upper())
        if event is not None:
            yield Remark(
                "names-differ-in-case",
                f"data {variable.name} is called as event {event.name} but for case: IEC 61131-3 takes both for one "
                "name",
                found.header.file,
                variable.line,
            )


def _inspect_text(block: model.BasicFBType | model.SimpleFBType, problems: _Problems) -> None:
    with problems.noted():
        add_reactions(unconnected(block), {})
    checker = BlockChecker(unconnected(block))
    for algorithm in block.algorithms:
        with problems.noted():
            checker.algorithm(algorithm)
    for transition in block.transitions if isinstance(block, model.BasicFBType) else ():
        if transition.guard:
            with problems.noted():
                checker.guard(transition)


def _inspect_system(drawn: model.System, library: Library, problems: _Problems) -> None:
    wrong = wrong_mappings(opened(drawn))
    for error in wrong.values():
        problems.note(error)
    sound = replace(drawn, mappings=tuple(m for m in drawn.mappings if m not in wrong))
    for application in opened(sound).applications:
        with problems.noted():
            _inspect_network(_without_start(application.network, problems), library.find, problems)
    system = library.complete(sound)
    for line in system.left_out:
        problems.remark(Remark("mapped-nowhere", f"left out: {line}"))
    for device in system.devices:
        for resource in device.resources:
            with problems.noted():
                network = resource_network(system, f"{device.name}.{resource.name}")
                _inspect_network(network, library.find, problems)


def _without_start(network: model.FBNetwork, problems: _Problems) -> model.FBNetwork:
    """An application without the connections of `START`, which is a block of the resources alone."""
    if any(block.name == "START" for block in network.blocks):
        return network
    from_start = [c for c in network.events if c.source.rpartition(".")[0] == "START"]
    for connection in from_start:
        message = (
            f"{connection.source} -> {connection.destination} of an application: START is a block of each resource: "
            "expected the connection there"
        )
        problems.remark(Remark("start-in-application", message, network.file, connection.line))
    return replace(network, events=tuple(c for c in network.events if c not in from_start))


def _linked(network: model.FBNetwork, find: Finder, problems: _Problems) -> Netlist | None:
    """The netlist of the part of a network that is right; what is wrong is noted; None when no such part is left."""
    for _ in range(MAXIMUM_PROBLEMS):
        try:
            return link(network, find)
        except FunctionBlockError as error:
            problems.note(error)
            smaller = _without(network, error) if error.file == network.file else network
            if smaller == network:
                return None
            network = smaller
    return None


def _without(network: model.FBNetwork, error: FunctionBlockError) -> model.FBNetwork:
    """A network without what stands in the line of an error: connections, else parameters, else blocks."""
    line = error.line

    def connected(network: model.FBNetwork, keep: Callable[[model.Connection], bool]) -> model.FBNetwork:
        return replace(
            network,
            events=tuple(filter(keep, network.events)),
            data=tuple(filter(keep, network.data)),
            adapters=tuple(filter(keep, network.adapters)),
        )

    found = connected(network, lambda c: c.line != line)
    if found == network:
        blocks = tuple(
            replace(b, parameters=tuple(p for p in b.parameters if p.line != line)) for b in network.blocks
        )
        found = replace(network, blocks=blocks)
    if found == network:
        gone = {block.name for block in network.blocks if block.line == line}
        found = replace(network, blocks=tuple(block for block in network.blocks if block.name not in gone))
        found = connected(found, lambda c: not {c.source.rpartition(".")[0], c.destination.rpartition(".")[0]} & gone)
    inside = tuple(replace(sub, network=_without(sub.network, error)) for sub in found.subapplications)
    return replace(found, subapplications=inside)


def _inspect_network(network: model.FBNetwork, find: Finder, problems: _Problems) -> None:
    """The connections and parameters of a network and of those inside it, and the text of all their blocks."""
    linked = _linked(network, find, problems)
    if linked is None:
        return
    netlist = linked
    problems.departures |= {str(warning): warning for warning in departures(netlist)}
    inspected: set[model.FBType] = set()
    connected: dict[int, set[str]] = {number: set() for number in netlist.nodes}
    for port in netlist.data:
        connected[port.node].add(port.name)
    for number, node in netlist.nodes.items():
        if isinstance(node.type, model.ServiceInterfaceFBType) and has_no_service(node.type):
            message = f"{node.name} is a {node.type.header.name}, a service that this device does not have: {_ABSENT}"
            problems.remark(Remark("no-such-service", message, node.file, node.line))
        if (problem := _protocol_problem(node, connected[number])) is not None:
            message = f"{node.name}: {problem}: {_ABSENT}"
            problems.remark(Remark("no-such-protocol", message, node.file, node.line))
        for variable in node.interface.inputs:
            parameter = node.parameters.get(variable.name)
            if parameter is not None and not isinstance(variable.type, model.GenericType):
                with problems.noted():
                    model.literal(parameter.value, variable.type, node.file, parameter.line)
        if isinstance(node.type, model.BasicFBType | model.SimpleFBType) and node.type not in inspected:
            inspected.add(node.type)
            if node.type.header.file:
                _inspect_text(node.type, problems)
