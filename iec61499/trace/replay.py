"""Repeats a trace: the same network is driven by what its service interface blocks issued then, event by event."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.runtime.operation import ObservedEvent, Operation, QueueEntry
from iec61499.runtime.resource import Resource
from iec61499.trace.ctf import EventKind, Record, Trace
from iec61499.trace.recorder import CHART, STATE, WRITTEN, layout


@dataclass(frozen=True, slots=True)
class Stop:
    """Where a replay has stopped.

    Attributes:
        count: how many events were equal before it.
        time: the time of the resource, ns.
        event: the event, `BLOCK.EVENT`.
        reason: what differs, or which state was reached.
        is_breakpoint: whether the state was reached that was asked for, and nothing differs.
    """

    count: int
    time: int
    event: str
    reason: str
    is_breakpoint: bool


@dataclass(frozen=True, slots=True)
class Replay:
    """What a replay has shown.

    Attributes:
        count: how many events were equal.
        constants: inputs that begin with another value than in the trace: name, value then, value now.
        stop: where it has stopped; None at the end of the trace.
    """

    count: int
    constants: tuple[tuple[str, Any, Any], ...]
    stop: Stop | None


def replay(trace: Trace, network: model.FBNetwork, library: Library, breakpoint: str = "") -> Replay:
    """Repeats a trace until an event differs, or until a chart enters a state.

    Args:
        trace: the trace, from the start of its resource on.
        network: what shall behave as in the trace.
        library: finds the block types that the network uses.
        breakpoint: `BLOCK.STATE`, where it stops the first time; "" for nowhere.

    Raises:
        FunctionBlockError: the network or the trace is wrong, or there is no such state.
    """
    return _Replay(trace, network, library, breakpoint).run()


class _Replay:
    def __init__(self, trace: Trace, network: model.FBNetwork, library: Library, breakpoint: str) -> None:
        self._trace = trace
        self._resource = Resource(network, library)
        self._seen: list[Record] = []
        self._kinds: dict[str, EventKind] = {}
        self._sources: dict[str, ObservedEvent] = {}
        self._constants: dict[str, tuple[Any, Any]] = {}
        self._before = self._resource.states()
        self._resource.change(network, Operation(observers=(self,), is_passive=True))
        self._block, self._state = self._located(breakpoint) if breakpoint else ("", -1)

    def delivering(self, event: ObservedEvent, deliver: QueueEntry) -> QueueEntry:
        name = event.name
        number = next((kind.number for kind in self._trace.kinds.values() if kind.name == name), -1)
        if number < 0:
            number = -2 - len(self._kinds)
            self._kinds[name] = EventKind(number, name, ())
        return _recording(number, event, deliver, self._seen.append)

    def issued(self, event: ObservedEvent) -> QueueEntry | None:
        if isinstance(event.kind, model.ServiceInterfaceFBType):
            self._sources[event.name] = event
        return None

    def written(self, time: int, name: str, value: Any) -> None:
        """What the replay writes itself."""

    def run(self) -> Replay:
        if "device" in self._trace.about:
            raise FunctionBlockError(
                "the trace is one of a device's watches: expected one of a run, with every event"
            )
        if not self._trace.is_whole:
            raise FunctionBlockError("the trace has lost its beginning: expected one from the start of its resource")
        count = 0
        constants: list[tuple[str, Any, Any]] = []
        for record in self._trace.records():
            kind = self._trace.kinds[record[0]]
            if kind.name == STATE:
                constants += self._differing(record)
                self._constants |= {name: (then, now) for name, then, now in constants}
            elif kind.name == WRITTEN:
                self._constants.pop(record[2], None)
                self._resource.write(record[2], json.loads(record[3]))
            else:
                problem = self._issue(kind, record) if kind.name in self._sources else self._deliver(kind, record)
                reached = self._reached(kind, record)
                if problem or reached:
                    stop = Stop(count, record[1], kind.name, problem or reached, not problem)
                    return Replay(count, tuple(constants), stop)
                count += 1
        return Replay(count, tuple(constants), None)

    def _differing(self, record: Record) -> list[tuple[str, Any, Any]]:
        """The values with which a block began otherwise in the trace."""
        name = record[2]
        now = json.loads(json.dumps(self._before.get(name, {})))
        return [
            (f"{name}.{variable}", value, now.get(variable))
            for variable, value in json.loads(record[3]).items()
            if repr(now.get(variable)) != repr(value)
        ]

    def _issue(self, kind: EventKind, record: Record) -> str:
        source = self._sources[kind.name]
        if layout(source.variables)[0] != kind.fields:
            return "the block has other outputs in the trace"
        at = 2
        values = {}
        for field in kind.fields:
            taken = record[at : at + field.count]
            values[field.name] = taken[0] if field.count == 1 else list(taken)
            at += field.count
        self._resource.issue_recorded(source.block.name__, source.event, values, record[1])
        return ""

    def _deliver(self, kind: EventKind, record: Record) -> str:
        self._seen.clear()
        try:
            # what a composite passes on inside is no event of its own
            while not self._seen:
                if not self._resource.deliver_next():
                    return "nothing happens here now"
        except FunctionBlockError as error:
            return f"it fails now: {error}"
        seen = self._seen[-1]
        if seen[0] != record[0]:
            names = {k.number: k.name for k in (*self._trace.kinds.values(), *self._kinds.values())}
            return f"{names.get(seen[0], 'another event')} comes now"
        if len(seen) != len(record):
            return "the block has other inputs in the trace"
        at = 2
        problems = self._constants_of(kind)
        for field in kind.fields:
            then, now = record[at : at + field.count], seen[at : at + field.count]
            if repr(then) != repr(now):
                name = f"state of the chart {CHART}" if field.name == CHART else field.name
                problems.append(f"{name} was {_shown(then)}, is {_shown(now)}")
            at += field.count
        return "; ".join(problems)

    def _constants_of(self, kind: EventKind) -> list[str]:
        """The constants in the WITH of an event that are others than in the trace."""
        block, _, event = kind.name.rpartition(".")
        inputs = self._resource.block_type(block).interface.event_inputs
        names = next((port.with_variables for port in inputs if port.name == event), ())
        sampled = [field.name for field in kind.fields]
        found = {name: self._constants.get(f"{block}.{name}") for name in names if name not in sampled}
        return [f"{name} was {pair[0]!r}, is {pair[1]!r}" for name, pair in found.items() if pair is not None]

    def _reached(self, kind: EventKind, record: Record) -> str:
        if kind.name.rpartition(".")[0] != self._block or not kind.fields or kind.fields[-1].name != CHART:
            return ""
        return f"{self._block} is in the state that was asked for" if record[-1] == self._state else ""

    def _located(self, breakpoint: str) -> tuple[str, int]:
        block, _, state = breakpoint.rpartition(".")
        kind = self._resource.block_type(block)
        names = [known.name for known in kind.states] if isinstance(kind, model.BasicFBType) else []
        if state not in names:
            raise FunctionBlockError(f"{block} has no state {state!r}: expected one of {', '.join(names) or 'none'}")
        return block, names.index(state)


def _recording(
    number: int, event: ObservedEvent, deliver: QueueEntry, append: Callable[[Record], None]
) -> QueueEntry:
    """What calls `deliver`, then appends the record, also when `deliver` fails."""
    values = [*layout(event.variables)[1], *["{b}.state__"] * isinstance(event.kind, model.BasicFBType)]
    space = {"deliver": deliver, "append": append, "b": event.block, "r": event.block.resource__}
    record = ", ".join([str(number), "r.time", *(value.format(b="b") for value in values)])
    lines = ["def recorded():", "    try:", "        deliver()", "    finally:", f"        append(({record}))"]
    exec("\n".join(lines), space)
    recorded: QueueEntry = space["recorded"]
    return recorded


def _shown(values: tuple[Any, ...]) -> str:
    return repr(values[0]) if len(values) == 1 else repr(list(values))
