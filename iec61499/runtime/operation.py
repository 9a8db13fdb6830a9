"""How a network is operated beside what it is: blocks that are stopped, forced ports, and observers of events."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from iec61499 import model

QueueEntry = Callable[[], None]
"""Delivers one event to one block."""


@dataclass(frozen=True, slots=True)
class ObservedEvent:
    """An event input or output of a block that runs.

    Attributes:
        block: the instance of the block.
        kind: the type of the block.
        event: the name of the event.
        variables: what comes with it: at an input the variables that are sampled from connections, at an output those
            in its WITH.
    """

    block: Any
    kind: model.FBType
    event: str
    variables: tuple[model.Variable, ...]

    @property
    def name(self) -> str:
        """`BLOCK.EVENT`."""
        return f"{self.block.name__}.{self.event}"


class Observer(Protocol):
    """Sees the events of a resource; both methods are called once for every port when the network is connected."""

    def delivering(self, event: ObservedEvent, deliver: QueueEntry) -> QueueEntry:
        """What delivers an event to a block in place of `deliver`, which samples its inputs and executes it."""

    def issued(self, event: ObservedEvent) -> QueueEntry | None:
        """What is done when the event output of a block has come, before its receivers have it; None for nothing."""

    def written(self, time: int, name: str, value: Any) -> None:
        """A variable, `BLOCK.VARIABLE`, has been given a value from outside, at a time of the resource in ns."""


class Path(dict[QueueEntry, "Path | None"]):
    """Where an event chain is: the path that an entry leads to, None if it has not followed here before."""

    def __missing__(self, entry: QueueEntry) -> None:
        """An entry that has not followed here before."""


class Tracer(Observer, Protocol):
    """An observer that is told every entry of the queue that is delivered, which costs less than a call of its own.

    Attributes:
        path: where the event chain is.
    """

    path: Path

    def follow(self, entry: QueueEntry, time: int) -> Path:
        """The path that an entry leads to which has not followed `path` before."""

    def end_chain(self, time: int) -> None:
        """The event chain has come to its end."""


class Undelivered(Exception):
    """An entry of the queue has failed."""

    def __init__(self, entry: QueueEntry, error: Exception) -> None:
        super().__init__(str(error))
        self.entry = entry
        self.error = error


def deliver_traced(queue: deque[QueueEntry], tracer: Tracer, size: int, time: int) -> bool:
    """Delivers at most `size` entries and tells the tracer; returns whether the queue was not found empty.

    Raises:
        Undelivered: an entry has failed.
    """
    path = tracer.path
    next_entry = queue.popleft
    for _ in range(size):
        if not queue:
            tracer.path = path
            tracer.end_chain(time)
            return False
        entry = next_entry()
        further = path[entry]
        if further is None:
            tracer.path = path
            further = tracer.follow(entry, time)
        path = further
        try:
            entry()
        except Exception as error:
            tracer.path = path
            raise Undelivered(entry, error) from None
    tracer.path = path
    return True


@dataclass(frozen=True, slots=True)
class Operation:
    """How a network is operated.

    Attributes:
        stopped: the names of blocks that get no events; what is inside a composite stops with it.
        forced: values by `BLOCK.PORT` that data ports have, whatever is written or connected to them.
        observers: who sees the events.
        tracer: one more observer, the last of them.
        is_passive: whether service interface blocks only sample their inputs; what they issue comes from elsewhere.
    """

    stopped: frozenset[str] = frozenset()
    forced: Mapping[str, Any] = field(default_factory=dict)
    observers: tuple[Observer, ...] = ()
    tracer: Tracer | None = None
    is_passive: bool = False

    def all_observers(self) -> tuple[Observer, ...]:
        """Who sees the events, in the order in which they do."""
        return self.observers if self.tracer is None else (*self.observers, self.tracer)

    def stops(self, name: str) -> bool:
        """Whether the block with this dotted name gets no events."""
        return bool(self.stopped) and any(name == other or name.startswith(f"{other}.") for other in self.stopped)


class EventCounts:
    """Counts the events at chosen ports.

    Attributes:
        counts: how often the event came since it was first watched, by `BLOCK.EVENT`.
    """

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}

    def watch(self, port: str) -> None:
        self.counts.setdefault(port, 0)

    def delivering(self, event: ObservedEvent, deliver: QueueEntry) -> QueueEntry:
        count = self.issued(event)
        if count is None:
            return deliver

        def counted() -> None:
            count()
            deliver()

        return counted

    def issued(self, event: ObservedEvent) -> QueueEntry | None:
        port = event.name
        if port not in self.counts:
            return None

        def count() -> None:
            if port in self.counts:
                self.counts[port] += 1

        return count

    def written(self, time: int, name: str, value: Any) -> None:
        """Values are no events."""
