"""Finds what is wrong with function-block files: schema, types, connections, Structured Text."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.departures.table import departures
from dtwin.iec61499.files.block_types import read_type
from dtwin.iec61499.library import Library
from dtwin.iec61499.management.bootfile import load_boot_file
from dtwin.iec61499.mapping import resource_network
from dtwin.iec61499.runtime.checker import BlockChecker
from dtwin.iec61499.runtime.compile import has_no_service
from dtwin.iec61499.runtime.inner_blocks import add_reactions
from dtwin.iec61499.runtime.linking.generic_ports import unconnected
from dtwin.iec61499.runtime.linking.linker import link
from dtwin.iec61499.runtime.linking.netlist import Finder

_ABSENT: Final = "it cannot run, or answers with QO = FALSE"
SUFFIXES: Final = (".fbt", ".fct", ".sub", ".sys", ".fboot")


@dataclass(frozen=True, slots=True)
class Findings:
    """What was found in a file, in the order of its lines as far as they are known; each once.

    Attributes:
        problems: what is wrong.
        departures: blocks that may compute something else on 4diac FORTE.
        remarks: connections of a system that no resource has, and services of blocks that this device does not have.
    """

    problems: tuple[FunctionBlockError, ...]
    departures: tuple[FunctionBlockError, ...]
    remarks: tuple[str, ...] = ()


def inspect(file: Path, library: Library) -> Findings:
    """Looks for what is wrong with a file, and for what differs on 4diac FORTE.

    Args:
        file: a block type (.fbt, .sub), system (.sys) or boot file (.fboot).
        library: finds the block types that the file uses.
    """
    problems = _Problems()
    with problems.noted():
        if file.suffix in (".fbt", ".fct", ".sub"):
            _inspect_type(file, library, problems)
        elif file.suffix == ".sys":
            system = library.load_system(file)
            problems.remarks |= dict.fromkeys(f"left out: {line}" for line in system.left_out)
            _inspect_system(system, library, problems)
        elif file.suffix == ".fboot":
            load_boot_file(file)
        else:
            raise FunctionBlockError("expected a file that ends in .fbt, .sub, .sys or .fboot", str(file))
    return Findings(_in_order(problems.found), _in_order(problems.departures), tuple(problems.remarks))


def _in_order(found: dict[str, FunctionBlockError]) -> tuple[FunctionBlockError, ...]:
    return tuple(sorted(found.values(), key=lambda error: (error.file, error.line, error.column)))


class _Problems:
    def __init__(self) -> None:
        self.found: dict[str, FunctionBlockError] = {}
        self.departures: dict[str, FunctionBlockError] = {}
        self.remarks: dict[str, None] = {}

    @contextmanager
    def noted(self) -> Iterator[None]:
        """Takes an error as a problem and goes on behind the block."""
        try:
            yield
        except FunctionBlockError as error:
            self.found.setdefault(str(error), error)


def _inspect_type(file: Path, library: Library, problems: _Problems) -> None:
    found = read_type(file, library)
    header = found.header
    if header.name != file.stem:
        message = f"holds the type {header.name}: expected {file.stem}, as the file's name says"
        problems.found[message] = FunctionBlockError(message, header.file, header.line)
    if isinstance(found, model.BasicFBType | model.SimpleFBType):
        _inspect_text(found, problems)
    elif isinstance(found, model.ServiceInterfaceFBType):
        with problems.noted():
            _inspect_service(library.find(header.name))
    else:

        def find(name: str, user: str, line: int) -> model.LibraryElement:
            return found if name == header.name else library.find(name, user, line)

        alone = model.FBNetwork((model.Block(header.name, header.name, line=header.line),), file=header.file)
        _inspect_network(alone, find, problems)


def _inspect_service(found: model.LibraryElement) -> None:
    """Raises FunctionBlockError for a block that has an interface and no behaviour here."""
    if isinstance(found, model.ServiceInterfaceFBType) and has_no_service(found):
        raise FunctionBlockError(
            f"{found.header.name} is an interface only, a service that this device does not have: {_ABSENT}",
            found.header.file,
            found.header.line,
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


def _inspect_system(system: model.System, library: Library, problems: _Problems) -> None:
    for application in system.applications:
        with problems.noted():
            _inspect_network(application.network, library.find, problems)
    for device in system.devices:
        for resource in device.resources:
            with problems.noted():
                network = resource_network(system, f"{device.name}.{resource.name}")
                _inspect_network(network, library.find, problems)


def _inspect_network(network: model.FBNetwork, find: Finder, problems: _Problems) -> None:
    """The connections and parameters of a network and of those inside it, and the text of all their blocks."""
    netlist = link(network, find)
    problems.departures |= {str(warning): warning for warning in departures(netlist)}
    inspected: set[model.FBType] = set()
    for node in netlist.nodes.values():
        if isinstance(node.type, model.ServiceInterfaceFBType) and has_no_service(node.type):
            remark = f"{node.file}:{node.line}: {node.name} is a {node.type.header.name}, a service that this device"
            problems.remarks[f"{remark} does not have: {_ABSENT}"] = None
        for variable in node.interface.inputs:
            parameter = node.parameters.get(variable.name)
            if parameter is not None and not isinstance(variable.type, model.GenericType):
                with problems.noted():
                    model.literal(parameter.value, variable.type, node.file, parameter.line)
        if isinstance(node.type, model.BasicFBType | model.SimpleFBType) and node.type not in inspected:
            inspected.add(node.type)
            if node.type.header.file:
                _inspect_text(node.type, problems)
