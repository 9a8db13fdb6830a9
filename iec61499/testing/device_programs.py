"""Programs that are tests on a device: 4diac FORTE, whose STEST_END would end the device itself, or `fb run`.

A TEST_CONDITION stands in the place of each STEST_END, so that the device goes on and tells by its event when the
test is over. Beside each TEST_CONDITION an E_SWITCH gets the same events just before it, and the same value. Behind
it are two more, one for failed checks and one for others, which let nothing through once the test is over; how often
their outputs came, which may be watched, is how often the check failed and how often it passed.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

from iec61499 import model
from iec61499.deploy.build import remove, suited
from iec61499.deploy.plan import plan_deployment
from iec61499.errors import CommunicationError, FunctionBlockError
from iec61499.library import Library
from iec61499.management.bootfile import Command
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import (
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    ManagementError,
    Request,
    RequestAction,
    Subject,
    Watch,
)
from iec61499.mapping import resource_network
from iec61499.runtime.checks import CHECK, END, Checks
from iec61499.testing.devices import READING
from iec61499.testing.runtimes import Inapplicable

_SWITCH: Final = "__CHECKED"
"""End of the name of the E_SWITCH beside a check; no identifier of a file has two underscores in a row."""
_GATES: Final = {"EO0": "__FAILED", "EO1": "__PASSED"}
"""Ends of the names of those behind it, by its outputs."""
_OVER: Final = "TEST__OVER"
"""The E_SR that says that the test is over."""


@dataclass
class Watched:
    """A program as a device gets it, and what is to be watched there.

    Attributes:
        commands: what builds it.
        resources: the resources that it creates.
        checks: its TEST_CONDITION blocks by resource.
        ends: its STEST_END blocks by resource.
    """

    commands: list[Command] = field(default_factory=list)
    resources: list[str] = field(default_factory=list)
    checks: dict[str, list[str]] = field(default_factory=dict)
    ends: dict[str, list[str]] = field(default_factory=dict)


def watched(commands: Sequence[Command]) -> Watched:
    """The program with blocks that can be watched."""
    made = Watched()
    for command in commands:
        subject = command.request.subject
        if isinstance(subject, ManagedConnection):
            made.commands += [*_mirrored(command, subject, made.checks.get(command.resource, [])), command]
        elif isinstance(subject, ManagedBlock) and command.request.action == "CREATE":
            made.commands += _created(command, subject, made)
        elif command.resource and subject is None and command.request.action == "START":
            made.commands += [*_gated(command, made), command]
        else:
            made.commands.append(command)
    return made


def _other(command: Command, subject: Subject, action: RequestAction = "CREATE") -> Command:
    return replace(command, request=Request(command.request.id, action, subject))


def _created(command: Command, block: ManagedBlock, made: Watched) -> Iterator[Command]:
    if not command.resource:
        made.resources.append(block.name)
    elif block.type_name == END:
        made.ends.setdefault(command.resource, []).append(block.name)
        yield _other(command, ManagedBlock(block.name, CHECK))
        yield _other(command, ManagedConnection("TRUE", f"{block.name}.check"), "WRITE")
        yield _other(command, Watch(f"{block.name}.CNF"))
        return
    elif block.type_name == CHECK:
        made.checks.setdefault(command.resource, []).append(block.name)
        switch = f"{block.name}{_SWITCH}"
        yield _other(command, ManagedBlock(switch, "E_SWITCH"))
        for output, ending in _GATES.items():
            yield _other(command, ManagedBlock(f"{block.name}{ending}", "E_SWITCH"))
            yield _other(command, ManagedConnection(f"{switch}.{output}", f"{block.name}{ending}.EI"))
            yield _other(command, Watch(f"{block.name}{ending}.EO0"))
    yield command


def _gated(command: Command, made: Watched) -> Iterator[Command]:
    """What has the checks of a resource that is started count no longer when one of its STEST_END has come."""
    ends, checks = made.ends.get(command.resource, []), made.checks.get(command.resource, [])
    if not ends:
        return
    yield _other(command, ManagedBlock(_OVER, "E_SR"))
    for name in ends:
        yield _other(command, ManagedConnection(f"{name}.CNF", f"{_OVER}.S"))
    for name in checks:
        for ending in _GATES.values():
            yield _other(command, ManagedConnection(f"{_OVER}.Q", f"{name}{ending}.G"))


def _mirrored(command: Command, connection: ManagedConnection, checks: Sequence[str]) -> Iterator[Command]:
    """The same for the E_SWITCH beside a check, when what is connected or written is an input of that check."""
    block, _, port = connection.destination.rpartition(".")
    if block in checks and port in ("REQ", "check"):
        ending = {"REQ": "EI", "check": "G"}[port]
        subject = replace(connection, destination=f"{block}{_SWITCH}.{ending}")
        yield replace(command, request=replace(command.request, subject=subject))


def system_commands(system: model.System, library: Library, client: ManagementClient) -> list[Command]:
    """What builds the resources of a system of one device.

    Raises:
        Inapplicable: the system has several devices.
        FunctionBlockError: the system or a type is wrong, or beyond what the device can have.
    """
    if len(system.devices) != 1:
        message = f"has {len(system.devices)} devices: expected one, to run it on the one device that is given"
        raise Inapplicable(message, system.header.file)
    (device,) = system.devices
    made: list[Command] = []
    for resource in device.resources:
        network = resource_network(system, f"{device.name}.{resource.name}")
        made += suited(client, partial(plan_deployment, resource.name, network, library, None)).commands
    return made


def run_on_device(client: ManagementClient, commands: Sequence[Command], file: str, longest: float) -> None:
    """Builds a program on a device, waits until it has come to its end, and removes it.

    Args:
        client: the session with the device.
        commands: what builds it.
        file: where they come from.
        longest: longest time to the end, s.

    Raises:
        FunctionBlockError: a check has failed, the device refuses a request, or the program does not come to its end.
        CommunicationError: the device does not answer.
    """
    program = watched(commands)
    there = {block.name for block in client.blocks("")} & set(program.resources)
    if there:
        message = f"the device has a resource {min(there)} already: delete it there, or name the other one otherwise"
        raise FunctionBlockError(message, file)
    try:
        _build(client, program.commands, file)
        checks = _awaited(client, program, file, longest)
    finally:
        if not client.lost:
            for resource in program.resources:
                remove(client, resource)
    if checks.failed:
        raise FunctionBlockError(str(checks), file)


def _build(client: ManagementClient, commands: Sequence[Command], file: str) -> None:
    for command in commands:
        subject = command.request.subject
        if isinstance(subject, ManagedType) and client.request("", "QUERY", ManagedType(subject.name)).reason is None:
            continue  # the device has it, with the same text, as its name ends with a digest of that
        try:
            client.demand(command.resource, command.request.action, subject)
        except ManagementError as error:
            raise FunctionBlockError(str(error), file, command.line) from None
        except CommunicationError as error:
            raise FunctionBlockError(f"{error}, at {command.request}", file, command.line) from None


def _awaited(client: ManagementClient, program: Watched, file: str, longest: float) -> Checks:
    """What the checks have found when the test has ended.

    A device goes on while it writes down its counts: what it tells of the checks may be older than what it tells of
    the end in the same answer. So they are read once more when the end has come.
    """
    end = time.monotonic() + longest
    over = False
    while True:
        counts = {name: client.watched(name) for name in {**program.checks, **program.ends}}
        checks = _found(program, counts)
        if over:
            return checks
        over = any(_came(counts[name], f"{block}.CNF") for name, blocks in program.ends.items() for block in blocks)
        if over:
            continue
        if time.monotonic() > end:
            said = f"; {checks}" if checks.made else ""
            raise FunctionBlockError(f"does not come to its {END} within {longest:g} s{said}", file)
        time.sleep(READING)


def _found(program: Watched, counts: Mapping[str, Mapping[str, str]]) -> Checks:
    """What the checks have found, by the counts of each resource."""
    checks = Checks()
    for name, blocks in program.checks.items():
        for block in blocks:
            failed, passed = (_came(counts[name], f"{block}{ending}.EO0") for ending in _GATES.values())
            checks.made += failed + passed
            if failed:
                checks.failed[block] = None
    return checks


def _came(counts: Mapping[str, str], event: str) -> int:
    """How often a watched event has come."""
    return int(counts.get(event, "0").split()[0])
