"""A whole system on a bench: all its resources in one process, with one simulated time."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from iec61499 import model
from iec61499.errors import FunctionBlockError, choices
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.native.hosted import HostedResource
from iec61499.runtime.checks import Checks, EndOfTest
from iec61499.runtime.communication import LocalTransport
from iec61499.runtime.resource import Resource
from iec61499.testing import session
from iec61499.testing.bench import caller_folder, duration_of, value_of
from iec61499.testing.coverage import CoveredLibrary


class SystemBench:
    """The resources of a system, in Python or as machine code.

    Ports are called `BLOCK.PORT`; where there are several resources `DEVICE.RESOURCE.BLOCK.PORT`, too.

    Attributes:
        checks: what its TEST_CONDITION blocks have found.
        ended: whether an STEST_END has ended it.
        time: the time since its start, s.
    """

    def __init__(self, system: model.System, library: Library, native: bool = False) -> None:
        names = [f"{device.name}.{resource.name}" for device in system.devices for resource in device.resources]
        if not names:
            raise FunctionBlockError("has no resource: expected blocks mapped to one", system.header.file)
        transport = LocalTransport()
        self._library = library
        kind: type[Resource | HostedResource] = HostedResource if native else Resource
        self._resources = {name: kind(resource_network(system, name), library, transport) for name in names}
        self.checks = Checks()
        self.ended = False
        for resource in self._resources.values():
            resource.checks = self.checks
        # The first device starts last, so that it finds the others listening.
        for resource in reversed(self._resources.values()):
            resource.issue_start()
            self._settle()

    @property
    def time(self) -> float:
        return max(resource.time for resource in self._resources.values()) / 1e9

    def resource(self, name: str = "") -> Resource | HostedResource:
        """A resource by `DEVICE.RESOURCE`; without a name the only one. Raises FunctionBlockError."""
        if name not in self._resources and (name or len(self._resources) > 1):
            raise FunctionBlockError(f"unknown resource {name!r}: expected {choices(self._resources)}")
        return self._resources[name] if name else next(iter(self._resources.values()))

    def __getitem__(self, port: str) -> Any:
        resource, name = self._located(port)
        return resource.read(name)

    def __setitem__(self, port: str, value: Any) -> None:
        resource, name = self._located(port)
        resource.write(name, value_of(value, resource.variable_type(name)))

    def trigger(self, event: str) -> None:
        """Lets an event happen, `BLOCK.EVENT`, and all that follows from it. Raises FunctionBlockError."""
        resource, name = self._located(event)
        resource.trigger(name)
        self._settle()

    def advance(self, duration: str | float) -> None:
        """Moves the time of all resources on, each timed event at its time.

        Args:
            duration: seconds, or a literal such as `T#250ms`.
        """
        target = max(resource.time for resource in self._resources.values()) + duration_of(duration)
        while not self.ended:
            due = [timer for each in self._resources.values() if (timer := each.next_timer()) is not None]
            until = min([target, *due])
            for resource in self._resources.values():
                while resource.ring(until):
                    self._settle()
            self._settle()
            if until == target:
                break

    def _settle(self) -> None:
        try:
            while not all(resource.is_idle for resource in self._resources.values()):
                for resource in self._resources.values():
                    resource.run_until_idle()
        except EndOfTest:
            self.ended = True

    def close(self) -> None:
        """Ends it; what it has executed is counted by then."""
        if isinstance(self._library, CoveredLibrary):
            for resource in self._resources.values():
                self._library.collect(resource)

    def _located(self, port: str) -> tuple[Resource | HostedResource, str]:
        for name, resource in self._resources.items():
            if port.startswith(f"{name}."):
                return resource, port.removeprefix(f"{name}.")
        if len(self._resources) == 1:
            return self.resource(), port
        found = [each for each in self._resources.values() if port.rpartition(".")[0] in each.names()]
        if len(found) != 1:
            valid = choices([f"{name}.{port}" for name in self._resources])
            raise FunctionBlockError(f"{port}: expected the resource in front: {valid}")
        return found[0], port


def system(file: str | Path, folder: str | Path | None = None) -> SystemBench:
    """A system with all its resources on a bench, started.

    Args:
        file: the system (.sys); a relative one beside the file that calls.
        folder: where the types are; without it the folder of the system.

    Raises:
        FunctionBlockError: the system or one of its types is wrong.
    """
    path = caller_folder(sys._getframe(1).f_globals) / file
    library = session.current.library(Path(folder) if folder is not None else path.parent)
    made = SystemBench(library.load_system(path), library, session.current.runtime == "native")
    session.current.opened.append(made.close)
    return made
