"""Repeats a trace: the same network is driven by what its service interface blocks issued then, event by event."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.library import Library
from dtwin.iec61499.runtime.operation import Operation, QueueEntry
from dtwin.iec61499.runtime.resource import Resource
from dtwin.iec61499.trace.ctf import EventKind, Record, Trace
from dtwin.iec61499.trace.recorder import CHART, STATE, WRITTEN, layout, recording


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
        self._sources: dict[str, tuple[Any, model.FBType]] = {}
        self._before = self._resource.states()
        self._resource.change(network, Operation(observers=(self,), is_passive=True))
        self._block, self._state = self._located(breakpoint) if breakpoint else ("", -1)

    def delivering(self, block: Any, kind: model.FBType, event: str, deliver: QueueEntry) -> QueueEntry:
        port = next(port for port in kind.interface.event_inputs if port.name == event)
        inputs = tuple(v for v in kind.interface.inputs if v.name in port.with_variables)
        values = layout(inputs)[1] + "b.state__, " * isinstance(kind, model.BasicFBType)
        name = f"{block.name__}.{event}"
        number = next((kind.number for kind in self._trace.kinds.values() if kind.name == name), -1)
        if number < 0:
            number = -2 - len(self._kinds)
            self._kinds[name] = EventKind(number, name, ())
        return recording(number, values, block, deliver, self._seen.append)

    def issued(self, block: Any, kind: model.FBType, event: str) -> QueueEntry | None:
        if isinstance(kind, model.ServiceInterfaceFBType):
            self._sources[f"{block.name__}.{event}"] = block, kind
        return None

    def written(self, time: int, name: str, value: Any) -> None:
        """What the replay writes itself."""

    def run(self) -> Replay:
        count = 0
        constants: list[tuple[str, Any, Any]] = []
        for record in self._trace.records():
            kind = self._trace.kinds[record[0]]
            if kind.name == STATE:
                constants += self._differing(record)
            elif kind.name == WRITTEN:
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
        block, type_ = self._sources[kind.name]
        event = kind.name.rpartition(".")[2]
        port = next(port for port in type_.interface.event_outputs if port.name == event)
        outputs = tuple(v for v in type_.interface.outputs if v.name in port.with_variables)
        if layout(outputs)[0] != kind.fields:
            return "the block has other outputs in the trace"
        at = 2
        values = {}
        for field in kind.fields:
            taken = record[at : at + field.count]
            values[field.name] = taken[0] if field.count == 1 else list(taken)
            at += field.count
        self._resource.issue_recorded(block.name__, event, values, record[1])
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
        problems = []
        for field in kind.fields:
            then, now = record[at : at + field.count], seen[at : at + field.count]
            if repr(then) != repr(now):
                name = f"state of the chart {CHART}" if field.name == CHART else field.name
                problems.append(f"{name} was {_shown(then)}, is {_shown(now)}")
            at += field.count
        return "; ".join(problems)

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


def _shown(values: tuple[Any, ...]) -> str:
    return repr(values[0]) if len(values) == 1 else repr(list(values))
