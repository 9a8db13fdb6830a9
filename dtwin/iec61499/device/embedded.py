"""The embedded runtime as a device: resources in real time, created by device management or from a file."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.device.managed_resource import ManagedResource
from dtwin.iec61499.device.requests import answer_on_types, execute
from dtwin.iec61499.device.runner import Runner
from dtwin.iec61499.library import Library
from dtwin.iec61499.management.bootfile import Command
from dtwin.iec61499.management.protocol import (
    ManagedBlock,
    ManagedType,
    ManagementError,
    Request,
    Response,
    Watch,
    parse_request,
    request_id,
)
from dtwin.iec61499.mapping import resource_network
from dtwin.iec61499.net.address import StreamAddress
from dtwin.iec61499.net.reactor import Reactor
from dtwin.iec61499.runtime.communication import LocalTransport

log = logging.getLogger(__name__)

RESOURCE_TYPE = "EMB_RES"


class EmbeddedDevice:
    """Holds the resources and answers management requests.

    Args:
        reactor: the event loop that serves all sockets and timers.
        library: the block types that the device has.
        management: address at which the device is managed. Multicast uses its network interface; SERVER blocks listen
            in its folder, if it is a Unix domain socket.
    """

    def __init__(self, reactor: Reactor, library: Library, management: StreamAddress) -> None:
        self._reactor = reactor
        self._library = library
        self._management = management
        self._local = LocalTransport()
        self._resources: dict[str, ManagedResource] = {}
        self._runners: list[Runner] = []

    def addresses(self) -> dict[str, StreamAddress]:
        """Where SERVER and SUBSCRIBE blocks listen, by dotted name."""
        return {name: address for runner in self._runners for name, address in runner.addresses.items()}

    def load_system(self, system: model.System, name: str = "") -> None:
        """Creates and starts the resources of a system configuration.

        Args:
            system: the system.
            name: the device of the system that this one is; "" for all of them together.

        Raises:
            FunctionBlockError: the system is wrong.
        """
        for device in [device for device in system.devices if name in ("", device.name)]:
            for declared in device.resources:
                network = resource_network(system, f"{device.name}.{declared.name}")
                if declared.name in self._resources:
                    raise FunctionBlockError(
                        f"two resources {declared.name}: expected one device of the system, or all as processes",
                        system.header.file,
                        declared.line,
                    )
                resource = ManagedResource(declared.name, RESOURCE_TYPE, self._library, self._launch, network)
                self._resources[declared.name] = resource
                try:
                    resource.change_state("START")
                except ManagementError as error:
                    raise FunctionBlockError(str(error)) from None

    def load_commands(self, commands: Iterable[Command], file: str = "") -> None:
        """Carries out a boot file.

        Raises:
            FunctionBlockError: a command is refused; names file and line.
        """
        for command in commands:
            try:
                self.execute(command.resource, command.request)
            except ManagementError as error:
                message = f"{command.request} refused: {error.reason}, {error}"
                raise FunctionBlockError(message, file, command.line) from None

    def handle(self, resource: str, text: str) -> str:
        """Answers a management request; both are XML. A refusal is one line in the log.

        A request that the device does not support is logged below warnings: a client may ask to find out.
        """
        try:
            return self.execute(resource, parse_request(text)).xml()
        except ManagementError as error:
            level = logging.INFO if error.reason == "UNSUPPORTED_CMD" else logging.WARNING
            log.log(level, "management: %s", error)
            return Response(request_id(text), error.reason).xml()
        except Exception as error:
            # nothing that a client asks for ends the device
            log.error("management: %.200s: %s: %s", text, type(error).__name__, error)
            return Response(request_id(text), "INVALID_OPERATION").xml()

    def execute(self, resource: str, request: Request) -> Response:
        """Carries out a request to a resource, or with "" to the device.

        Raises:
            ManagementError: the request is refused; carries the reason.
        """
        if not resource:
            return self._execute_here(request)
        if resource not in self._resources:
            raise ManagementError("INVALID_DST", f"no resource {resource!r}")
        return execute(self._resources[resource], request, self._library)

    def close(self) -> None:
        """Ends all resources."""
        for resource in self._resources.values():
            resource.close()
        self._runners.clear()

    def _execute_here(self, request: Request) -> Response:
        action, subject = request.action, request.subject
        if isinstance(subject, ManagedType):
            return answer_on_types(request, subject, self._library)
        if subject is None and action == "KILL":
            for resource in self._resources.values():
                if resource.state == "RUNNING":
                    resource.change_state("KILL")
            return Response(request.id)
        if subject is None:
            raise ManagementError("INVALID_STATE", f"the device runs: cannot {action} it")
        if subject == Watch() and action == "READ":
            return Response(request.id, watches={r.name: r.watched() for r in self._resources.values()})
        if not isinstance(subject, ManagedBlock):
            raise ManagementError("NO_SUCH_OBJECT", f"the device has no {request.action} for connections")
        if action == "QUERY":
            resources = self._resources.values()
            return Response(request.id, blocks=tuple(ManagedBlock(r.name, r.type_name) for r in resources))
        if action == "CREATE":
            self._create(subject)
            return Response(request.id)
        if subject.name not in self._resources:
            raise ManagementError("NO_SUCH_OBJECT", f"no resource {subject.name!r}")
        resource = self._resources[subject.name]
        if action == "DELETE":
            if resource.state == "RUNNING":
                raise ManagementError("INVALID_STATE", f"{resource.name} is RUNNING: cannot delete it")
            resource.close()
            del self._resources[resource.name]
        elif action in ("READ", "WRITE"):
            raise ManagementError("INVALID_OBJECT", f"{action}: expected a connection")
        else:
            resource.change_state(action)
        return Response(request.id)

    def _create(self, subject: ManagedBlock) -> None:
        if not subject.name or subject.name in self._resources:
            raise ManagementError("INVALID_STATE", f"there is a resource {subject.name!r} already")
        if subject.type_name != RESOURCE_TYPE:
            raise ManagementError(
                "UNSUPPORTED_TYPE", f"resource type {subject.type_name!r}: expected {RESOURCE_TYPE}"
            )
        resource = ManagedResource(subject.name, subject.type_name, self._library, self._launch)
        self._resources[subject.name] = resource

    def _launch(self, network: model.FBNetwork, failed: Callable[[], None]) -> Runner:
        self._runners = [runner for runner in self._runners if not runner.is_closed]
        runner = Runner(network.file, self._reactor, network, self._library, self._local, self._management, failed)
        self._runners.append(runner)
        return runner
