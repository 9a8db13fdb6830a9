"""Builds a planned resource on a device, 4diac FORTE or `dtwin fb run`, in place of the one of that name."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Protocol

from iec61499.deploy.cpp_export import built_in_type
from iec61499.deploy.device_type import TypeExport, is_built_in, original_name
from iec61499.deploy.listing import Listing, write_note
from iec61499.deploy.lua_export import export_type
from iec61499.deploy.plan import Deployment
from iec61499.errors import FunctionBlockError
from iec61499.management.bootfile import Command
from iec61499.management.client import ManagementClient, Step
from iec61499.management.protocol import (
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    ManagementError,
    Reason,
    Request,
)

Planner = Callable[[TypeExport], Deployment]
"""Plans a resource for devices that get the types of its blocks in one way."""


class HasTypes(Protocol):
    """A device, as far as it tells what it has."""

    def types(self) -> Collection[str]:
        """The names of its block types."""


def suited(client: HasTypes, plan: Planner) -> Deployment:
    """The plan for a device: with types built into it if it has all of them in this version, otherwise as Lua.

    Raises:
        FunctionBlockError: as `plan_deployment`.
        CommunicationError: the device does not answer.
    """
    names = {name for name in client.types() if is_built_in(name)}
    if names:
        try:
            built_in = plan(built_in_type)
        except FunctionBlockError:
            return plan(export_type)  # which says what is wrong, or does what C cannot
        if all(kind.name in names for kind in built_in.types):
            return built_in
    return plan(export_type)


def deploy(client: ManagementClient, deployment: Deployment) -> None:
    """Builds and starts the resource.

    The block types come first: a device that cannot take them keeps what it runs. What fails later leaves no half
    resource behind. Types that are built in must be there, as `suited` finds.

    Raises:
        ManagementError: the device refuses; names the block.
        CommunicationError: the device does not answer.
    """
    types = [command for command in deployment.commands if isinstance(command.request.subject, ManagedType)]
    _demand_all(client, deployment, _unknown(client, deployment, types))
    remove(client, deployment.resource)
    try:
        _demand_all(client, deployment, deployment.commands[len(types) :])
        note(client, deployment)
    except ManagementError:
        remove(client, deployment.resource)
        raise


def note(client: ManagementClient, deployment: Deployment) -> None:
    """Leaves on a device what has been built there, if it does not list that. Raises as `deploy`."""
    subjects = [c.request.subject for c in deployment.commands if c.resource == deployment.resource]
    actions = [c.request.action for c in deployment.commands if c.resource == deployment.resource]
    made = [subject for subject, action in zip(subjects, actions, strict=True) if action == "CREATE"]
    built = Listing(
        tuple((s.name, s.type_name) for s in made if isinstance(s, ManagedBlock)),
        tuple((s.source, s.destination) for s in made if isinstance(s, ManagedConnection)),
    )
    write_note(client, deployment.resource, built, short=not any(kind.text for kind in deployment.types))


def remove(client: ManagementClient, resource: str) -> None:
    """Stops and deletes a resource, if there is one of that name. Raises ManagementError when that is refused."""
    if all(block.name != resource for block in client.blocks("")):
        return
    # what is not running refuses to stop and to be killed, and may be deleted
    client.request("", "STOP", ManagedBlock(resource, ""))
    # FORTE goes on through its list of sockets behind that of the request, while KILL takes those of the resource
    # out of it; behind the socket of a new session there are none
    client.reconnect()
    client.request("", "KILL", ManagedBlock(resource, ""))
    client.delete_block("", resource)


def _unknown(client: ManagementClient, deployment: Deployment, types: Sequence[Command]) -> list[Command]:
    """The types that the device does not have yet, with the same text, since a name ends with a digest of it."""
    subjects = [command.request.subject for command in types]
    queries: list[Step] = [("", "QUERY", ManagedType(s.name)) for s in subjects if isinstance(s, ManagedType)]
    unknown = []
    for command, response in zip(types, client.request_all(queries), strict=True):
        if response.reason == "UNSUPPORTED_TYPE":
            unknown.append(command)
        elif response.reason is not None:
            # without Lua, FORTE's buffer is too short for a type: it would not even refuse one
            raise _refused(client, deployment, command.request, "UNSUPPORTED_CMD")
    return unknown


def _demand_all(client: ManagementClient, deployment: Deployment, commands: Sequence[Command]) -> None:
    coming = iter(commands)
    try:
        for _ in client.demand_all([(c.resource, c.request.action, c.request.subject) for c in commands]):
            next(coming)
    except ManagementError as error:
        raise _refused(client, deployment, next(coming).request, error.reason) from None


def _refused(client: ManagementClient, deployment: Deployment, request: Request, reason: Reason) -> ManagementError:
    return ManagementError(reason, f"{client.address}: {_refusal(client, deployment, request, reason)}")


def _refusal(client: ManagementClient, deployment: Deployment, request: Request, reason: Reason) -> str:
    subject = request.subject
    if isinstance(subject, ManagedType):
        blocks = [command.request.subject for command in deployment.commands]
        user = next(
            block.name for block in blocks if isinstance(block, ManagedBlock) and block.type_name == subject.name
        )
        needed = {
            "UNSUPPORTED_CMD": "the device takes no block types: expected dtwin fb run, or a 4diac FORTE built with "
            f"FORTE_USE_LUATYPES or with what dtwin fb export --format forte writes{_other_version(client, subject)}",
            "UNSUPPORTED_TYPE": "the device has no such block type, or another one of that name: expected the "
            "same library",
        }.get(reason, "the device cannot read it: expected a 4diac FORTE with Lua 5.1 or later")
        return f"refused type {subject.name} of block {user}: {reason}: {needed}"
    if isinstance(subject, ManagedBlock) and reason == "UNSUPPORTED_TYPE":
        return (
            f"refused block {subject.name}: the device has no type {subject.type_name}: "
            "expected a 4diac FORTE built with the module that holds it"
        )
    return f"refused {request} in resource {deployment.resource}: {reason}"


def _other_version(client: ManagementClient, subject: ManagedType) -> str:
    """What the device has built in in place of a type."""
    wanted = original_name(subject.name)
    found = next((name for name in client.types() if is_built_in(name) and original_name(name) == wanted), "")
    return f"; {found}, which it has, is of another version of the library" if found else ""
