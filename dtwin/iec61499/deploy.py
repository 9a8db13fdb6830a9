"""Builds a planned resource on a device, 4diac FORTE or `dtwin fb run`, in place of the one of that name."""

from __future__ import annotations

from dtwin.iec61499.deployment import Deployment
from dtwin.iec61499.management import Block, ManagementError, Reason, Request, Type
from dtwin.iec61499.management_client import ManagementClient


def deploy(client: ManagementClient, deployment: Deployment) -> None:
    """Builds and starts the resource.

    The block types come first: a device that cannot take them keeps what it runs. What fails later leaves no half
    resource behind.

    Raises:
        ManagementError: the device refuses; names the block.
        CommunicationError: the device does not answer.
    """
    building = False
    for command in deployment.commands:
        request = command.request
        creates = not command.resource and isinstance(request.subject, Block)
        if creates:
            remove(client, deployment.resource)
        reason = client.request(command.resource, request.action, request.subject).reason
        if reason is not None:
            if building:
                remove(client, deployment.resource)
            raise ManagementError(reason, f"{client.address}: {_refusal(deployment, request, reason)}")
        building = building or creates


def remove(client: ManagementClient, resource: str) -> None:
    """Kills and deletes a resource, if there is one of that name. Raises ManagementError when it cannot be."""
    if any(block.name == resource for block in client.blocks("")):
        # refused where it does not run, which deleting then takes
        client.request("", "KILL", Block(resource, ""))
        client.delete_block("", resource)


def _refusal(deployment: Deployment, request: Request, reason: Reason) -> str:
    subject = request.subject
    if isinstance(subject, Type):
        blocks = [c.request.subject for c in deployment.commands]
        user = next(block.name for block in blocks if isinstance(block, Block) and block.type_name == subject.name)
        if reason in ("UNSUPPORTED_CMD", "UNSUPPORTED_TYPE"):
            needed = (
                "the device does not take block types: expected a 4diac FORTE built with FORTE_USE_LUATYPES, "
                "or dtwin fb run with the same library"
            )
        else:
            needed = "expected a 4diac FORTE with Lua 5.1 or later"
        return f"refused type {subject.name} of block {user}: {reason}: {needed}"
    if isinstance(subject, Block) and reason == "UNSUPPORTED_TYPE":
        return (
            f"refused block {subject.name}: it has no type {subject.type_name}: "
            "expected a 4diac FORTE built with the module that holds it"
        )
    return f"refused {request} in resource {deployment.resource}: {reason}"
