"""The runtimes that a block under test may have: the embedded one, machine code, or a device."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, Protocol

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.native.hosted import HostedResource
from iec61499.runtime.operation import ObservedEvent, Operation, QueueEntry
from iec61499.runtime.resource import Resource
from iec61499.testing import probe
from iec61499.testing.coverage import CoveredLibrary

Issued = tuple[str, Mapping[str, Any]]
"""An event output, and the values of the outputs in its WITH as a receiver sees them."""
CHART: Final = "$ECC"
"""The variable that holds the state of a chart."""
LONGEST: Final = 86_400_000_000_000
"""Longest time for which an output is waited for, ns of simulated time."""


class Inapplicable(FunctionBlockError):
    """A test describes what its block or the runtime does not have: a draft of an editor, or what a platform does."""


class Runtime(Protocol):
    """What executes the block under test."""

    def fire(self, event: str) -> None:
        """Lets the block have an event, and what follows from it at once."""

    def advance(self, duration: int) -> None:
        """Moves time on by ns."""

    def due(self) -> int | None:
        """How long until a timed block issues its event, ns; None when none waits or nothing is known."""

    def wait(self, number: int) -> tuple[Issued, ...]:
        """The events that come out later, until there are so many, nothing more comes, or it has taken too long."""

    def issued(self) -> tuple[Issued, ...]:
        """The events that have come out since they were asked for last, in their order."""

    def read(self, name: str) -> Any:
        """The value of a variable of the block. Raises FunctionBlockError."""

    def write(self, name: str, value: Any) -> None:
        """Sets an input. Raises FunctionBlockError."""

    def close(self) -> None:
        """Ends it."""


class _Notes:
    """Observes the events that reach the probe, with the values that the outputs have by then."""

    def __init__(self, kind: model.LibraryElement, read: Callable[[str], Any]) -> None:
        self._outputs = kind.interface.event_outputs
        self._read = read
        self.events: list[Issued] = []

    def delivering(self, event: ObservedEvent, deliver: QueueEntry) -> QueueEntry:
        if event.block.name__ != probe.PROBE:
            return deliver
        output = self._outputs[int(event.event.removeprefix("E"))]

        def noted() -> None:
            self.events.append((output.name, {name: self._read(name) for name in output.with_variables}))
            deliver()

        return noted

    def issued(self, event: ObservedEvent) -> QueueEntry | None:
        return None

    def written(self, time: int, name: str, value: Any) -> None:
        """Values are no events."""


class _Simulated(Runtime):
    """The block in a resource whose time is simulated."""

    _library: Library
    _resource: Resource | HostedResource

    def fire(self, event: str) -> None:
        self._resource.trigger(f"{probe.BLOCK}.{event}")
        self._resource.run_until_idle()

    def advance(self, duration: int) -> None:
        self._resource.advance(duration)

    def due(self) -> int | None:
        timer = self._resource.next_timer()
        return None if timer is None else timer - self._resource.time

    def wait(self, number: int) -> tuple[Issued, ...]:
        return _waited(self, number)

    def read(self, name: str) -> Any:
        return self._resource.read(f"{probe.BLOCK}.{name}")

    def write(self, name: str, value: Any) -> None:
        self._resource.write(f"{probe.BLOCK}.{name}", value)

    def close(self) -> None:
        if isinstance(self._library, CoveredLibrary):
            self._library.collect(self._resource)


class EmbeddedRuntime(_Simulated):
    """The block in a resource of this process, whose time is simulated."""

    def __init__(self, kind: model.LibraryElement, library: Library, parameters: Mapping[str, str]) -> None:
        self._library = library
        self._notes = _Notes(kind, self.read)
        library.add(probe.probe_type(kind))
        network = probe.network(kind, parameters)
        self._resource = Resource(network, library)
        self._resource.change(network, Operation(observers=(self._notes,)))
        self._resource.start()

    def issued(self) -> tuple[Issued, ...]:
        found = tuple(self._notes.events)
        self._notes.events.clear()
        return found


class NativeRuntime(_Simulated):
    """The block as machine code. Of several events of one call the values are those after the last."""

    def __init__(self, kind: model.LibraryElement, library: Library, parameters: Mapping[str, str]) -> None:
        self._kind = kind
        self._library = library
        library.add(probe.probe_type(kind))
        self._resource = HostedResource(probe.network(kind, parameters), library)
        self._resource.start()

    def issued(self) -> tuple[Issued, ...]:
        outputs = self._kind.interface.event_outputs
        count = self._resource.read(f"{probe.PROBE}.COUNT")
        log = self._resource.read(f"{probe.PROBE}.LOG")[:count]
        self._resource.write(f"{probe.PROBE}.COUNT", 0)
        return tuple(
            (outputs[number].name, {name: self.read(name) for name in outputs[number].with_variables})
            for number in log
        )


def _waited(running: Runtime, number: int) -> tuple[Issued, ...]:
    """Moves simulated time on to one timed event after another until so many events have come out."""
    came: list[Issued] = []
    waited = 0
    while len(came) < number and (due := running.due()) is not None and waited + due <= LONGEST:
        running.advance(due)
        waited += due
        came += running.issued()
    return tuple(came)
