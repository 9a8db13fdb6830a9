"""The embedded runtime as a device: resources in real time, created by device management or from a file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

from iec61499 import model
from iec61499.device.managed_resource import ManagedResource
from iec61499.device.preparation import Preparation, Worker
from iec61499.device.requests import answer_on_types, asks_for_much, execute
from iec61499.device.runner import Runner
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.management.bootfile import Command
from iec61499.management.protocol import (
    ManagedBlock,
    ManagedType,
    ManagementError,
    Request,
    Response,
    Watch,
)
from iec61499.mapping import device_network
from iec61499.net.address import StreamAddress
from iec61499.net.protocols import Protocols
from iec61499.net.reactor import Reactor
from iec61499.net.settings import Connections
from iec61499.net.transport import Surroundings
from iec61499.runtime.checks import END, Checks, EndOfTest
from iec61499.runtime.communication import LocalTransport

RESOURCE_TYPE = "EMB_RES"


class EmbeddedDevice:
    """Holds the resources and answers management requests.

    What takes long in a request, such as compiling a type, is done in a thread while the resources go on; the request
    is carried out afterwards, between events.

    Attributes:
        protocols: what its blocks share to reach others by more than sockets.

    Args:
        reactor: the event loop that serves all sockets and timers.
        library: the block types that the device has.
        management: address at which the device is managed. Multicast uses its network interface; SERVER blocks listen
            in its folder, if it is a Unix domain socket.
        test_over: called when a test has ended: by an STEST_END, or in an error of a resource of a program with one.
        connections: where its own OPC UA server listens, and how to log in to other servers.
        native: whether machine code executes the resources, which then are not changed while they run.
    """

    def __init__(
        self,
        reactor: Reactor,
        library: Library,
        management: StreamAddress,
        test_over: Callable[[], None] = lambda: None,
        connections: Connections | None = None,
        native: bool = False,
    ) -> None:
        self._test_over = test_over
        self._native = native
        self._checks = Checks()
        self._failed = False
        self._reactor = reactor
        self._library = library
        self.protocols = Protocols(connections)
        self._surroundings = Surroundings(LocalTransport(), self.protocols, management)
        self._resources: dict[str, ManagedResource] = {}
        self._preparation = Preparation(library)
        self._worker = Worker(reactor)

    def addresses(self) -> dict[str, StreamAddress]:
        """Where SERVER and SUBSCRIBE blocks listen, by dotted name."""
        resources = self._resources.values()
        return {name: address for resource in resources for name, address in resource.addresses().items()}

    @property
    def has_failed(self) -> bool:
        """Whether a check has failed, or an error has ended a resource and none runs any more."""
        running = any(resource.state == "RUNNING" for resource in self._resources.values())
        return bool(self._checks.failed) or (self._failed and (self._is_test() or not running))

    @property
    def verdict(self) -> str:
        """What the checks of the program have found, in one line."""
        return str(self._checks) if self._checks.failed else "an error has ended a resource, which the log tells"

    def _is_test(self) -> bool:
        """Whether a resource has a block that ends a test."""
        return any(block.type_name == END for resource in self._resources.values() for block in resource.blocks())

    def load_system(self, system: model.System, name: str = "") -> None:
        """Creates and starts the resources of a system configuration.

        Args:
            system: the system.
            name: the device of the system that this one is; "" for all of them together.

        Raises:
            FunctionBlockError: the system is wrong.
        """
        made = []
        for device in [device for device in system.devices if name in ("", device.name)]:
            for declared in device.resources:
                network = device_network(system, f"{device.name}.{declared.name}")
                if declared.name in self._resources:
                    raise FunctionBlockError(
                        f"two resources {declared.name}: expected one device of the system, or all as processes",
                        system.header.file,
                        declared.line,
                    )
                resource = ManagedResource(
                    declared.name, RESOURCE_TYPE, self._library, self._launch, network, self._native
                )
                self._resources[declared.name] = resource
                made.append(resource)
                self._preparation.prepare_network(network)
        for resource in made:
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

    def handle(self, resource: str, request: Request, answer: Callable[[Response | Exception], None]) -> None:
        """Answers a management request, now or when what it needs is ready; with an error if it is refused.

        Until the answer no other request may come.
        """
        try:
            slow = self._slow_part(resource, request)
        except Exception as error:
            answer(error)
            return

        def finish(prepared: Callable[[], Response | None]) -> None:
            outcome: Response | Exception
            try:
                outcome = prepared() or self._execute(resource, request)
            except Exception as error:
                # nothing that a client asks for ends the device
                outcome = error
            answer(outcome)

        if slow is None:
            finish(lambda: None)
        else:
            self._worker.submit(slow, lambda outcome: finish(outcome.result))

    def execute(self, resource: str, request: Request) -> Response:
        """Carries out a request to a resource, or with "" to the device.

        Raises:
            ManagementError: the request is refused; carries the reason.
        """
        slow = self._slow_part(resource, request)
        return (slow() if slow is not None else None) or self._execute(resource, request)

    def _slow_part(self, resource: str, request: Request) -> Callable[[], Response | None] | None:
        """What takes long in a request, which may be done in another thread; it gives the response if it is all."""
        action, subject = request.action, request.subject
        if isinstance(subject, ManagedType):
            quick = self._preparation.is_ready(subject.name) and not asks_for_much(request, subject)
            if quick or resource not in ("", *self._resources):
                return None
            return partial(answer_on_types, request, subject, self._library)
        block = subject if isinstance(subject, ManagedBlock) else None
        if block is not None and resource and action == "CREATE":
            name = block.type_name
            return None if self._preparation.is_ready(name) else partial(self._preparation.prepare, name)
        if action == "START" and (subject is None) == bool(resource):
            found = self._resources.get(resource or (block.name if block is not None else ""))
            return found.prepare if found is not None else None
        return None

    def _execute(self, resource: str, request: Request) -> Response:
        if not resource:
            return self._execute_here(request)
        if resource not in self._resources:
            raise ManagementError("INVALID_DST", f"no resource {resource!r}")
        return execute(self._resources[resource], request, self._library)

    def close(self) -> None:
        """Ends all resources."""
        self._worker.close()
        for resource in self._resources.values():
            resource.close()
        self.protocols.close()

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
        resource = ManagedResource(subject.name, subject.type_name, self._library, self._launch, fixed=self._native)
        self._resources[subject.name] = resource

    def _launch(self, network: model.FBNetwork, failed: Callable[[], None]) -> Runner:
        def ended(error: Exception) -> None:
            failed()
            test = isinstance(error, EndOfTest)
            self._failed = self._failed or not test
            if test or self._is_test():
                self._test_over()

        where = self._library, self._surroundings
        return Runner(network.file, self._reactor, network, *where, ended, self._checks, self._native)
