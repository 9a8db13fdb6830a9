"""How a network is operated beside what it is: blocks that are stopped, forced ports, and observers of events."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from dtwin.iec61499 import model

QueueEntry = Callable[[], None]
"""Delivers one event to one block."""


class Observer(Protocol):
    """Sees the events of a resource; both methods are called once for every port when the network is connected."""

    def delivering(self, block: Any, kind: model.FBType, event: str, deliver: QueueEntry) -> QueueEntry:
        """What delivers an event to a block in place of `deliver`, which it calls.

        Args:
            block: the instance of the block.
            kind: the type of the block.
            event: the name of the event input.
            deliver: samples the inputs of the block and executes it.
        """

    def issued(self, block: Any, kind: model.FBType, event: str) -> QueueEntry | None:
        """What is done when the event output of a block has come, before its receivers have it; None for nothing."""

    def written(self, time: int, name: str, value: Any) -> None:
        """A variable, `BLOCK.VARIABLE`, has been given a value from outside, at a time of the resource in ns."""


@dataclass(frozen=True, slots=True)
class Operation:
    """How a network is operated.

    Attributes:
        stopped: the names of blocks that get no events; what is inside a composite stops with it.
        forced: values by `BLOCK.PORT` that data ports have, whatever is written or connected to them.
        observers: who sees the events.
        is_passive: whether service interface blocks only sample their inputs; what they issue comes from elsewhere.
    """

    stopped: frozenset[str] = frozenset()
    forced: Mapping[str, Any] = field(default_factory=dict)
    observers: tuple[Observer, ...] = ()
    is_passive: bool = False

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

    def delivering(self, block: Any, kind: model.FBType, event: str, deliver: QueueEntry) -> QueueEntry:
        count = self.issued(block, kind, event)
        if count is None:
            return deliver

        def counted() -> None:
            count()
            deliver()

        return counted

    def written(self, time: int, name: str, value: Any) -> None:
        """Values are no events."""

    def issued(self, block: Any, kind: model.FBType, event: str) -> QueueEntry | None:
        port = f"{block.name__}.{event}"
        if port not in self.counts:
            return None

        def count() -> None:
            if port in self.counts:
                self.counts[port] += 1

        return count
