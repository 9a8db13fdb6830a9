"""Records every event of a resource with its data.

What is recorded is read when the event chain has ended, for all events of the chain at once, as every block has then
what it had after its event; the part of a chain before an event that may change this is recorded apart. For sequences
of events that come often the bytes are written by one generated expression.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from typing import Any, Final

from iec61499 import model
from iec61499.library import Library
from iec61499.runtime.operation import ObservedEvent, Path, QueueEntry
from iec61499.runtime.resource import Resource
from iec61499.st.python.expressions import python_name
from iec61499.trace.ctf import TEXT, EventKind, Field, TraceWriter, encoding
from iec61499.types import ArrayType, DataType

STATE: Final = "state"
"""The kind of event that holds the variables of a block when the trace begins."""
WRITTEN: Final = "written"
"""The kind of event that holds a value which was written from outside."""
CHART: Final = "ECC"
"""The field that holds the number of the state of a chart."""
CHART_FIELD: Final = Field(CHART, "uint_t")
PACKET: Final = 2000
"""Records after which a packet is written."""
LONGEST: Final = 64
"""Most events that are recorded at once."""
OFTEN: Final = 10
"""How often a sequence of events comes before an expression is generated for it."""
PATHS: Final = 2000
"""Most sequences that are known; one more, and all are forgotten."""
_NAMES: Final = {
    "BYTE": "usint_t",
    "WORD": "uint_t",
    "DWORD": "udint_t",
    "LWORD": "ulint_t",
    **dict.fromkeys(("TIME", "LTIME"), "lint_t"),
}

Encode = Callable[[int], bytes]
"""Gives the bytes of records, at a time of the resource in ns."""


class _Source:
    """What is recorded of an event: its kind, the expressions of its fields for a block `{b}`, and the block."""

    def __init__(self, kind: EventKind, expressions: tuple[str, ...], block: Any, is_output: bool) -> None:
        self.kind = kind
        self.expressions = expressions
        self.block = block
        self.is_output = is_output

    @cached_property
    def encode(self) -> Encode:
        return _encoder([self])


class _Path(Path):
    """The events of a chain since it was recorded last.

    Attributes:
        sources: what is recorded of them.
        last: entries before which they have to be recorded.
    """

    __slots__ = ("count", "encode", "last", "sources")

    def __init__(self, sources: tuple[_Source, ...] = ()) -> None:
        super().__init__()
        self.sources = sources
        self.last: set[QueueEntry] = set()
        self.count = 0
        self.encode: Encode = self._one_by_one

    def _one_by_one(self, time: int) -> bytes:
        self.count += 1
        if self.count > OFTEN:
            self.encode = _encoder(self.sources)
        return b"".join([source.encode(time) for source in self.sources])


def _may_change(before: _Source, source: _Source) -> bool:
    """Whether an event may change what is recorded of one before it.

    It may when both are of one block, or when it lets a block send something that another one puts out at once.
    """
    sends = not source.is_output and hasattr(source.block, "port__")
    return before.block is source.block or (sends and before.is_output)


class Recorder:
    """A tracer that writes a trace.

    An event at an input is recorded with the inputs that were sampled from connections and the state of the chart
    afterwards; inputs that nothing is connected to are in the records of the beginning. An event that a service
    interface block issues is recorded with the outputs, before its receivers have it.

    Args:
        writer: writes the trace.
    """

    def __init__(self, writer: TraceWriter) -> None:
        self._writer = writer
        self._root = _Path()
        self.path: Path = self._root
        self._paths = 0
        self._sources: dict[QueueEntry, _Source] = {}
        self._entries: dict[str, QueueEntry] = {}
        self._packet: list[bytes] = []
        self._count = 0
        self._first = self._last = 0
        writer.end_with(self.flush)
        text = (Field("name", TEXT), Field("value", TEXT))
        self._state, self._written = (_text_encoder(writer.kind(name, text)) for name in (STATE, WRITTEN))

    def start(self, time: int, states: dict[str, dict[str, Any]]) -> None:
        """Records the variables of all blocks, by the name of the block."""
        for name, values in states.items():
            self._add(time, self._state(time, name, json.dumps(values)), 1)

    def delivering(self, event: ObservedEvent, deliver: QueueEntry) -> QueueEntry:
        # two events of a block may have entries that count as equal
        entry = partial(deliver) if deliver in self._sources else deliver
        self._know(event, entry)
        return entry

    def issued(self, event: ObservedEvent) -> QueueEntry | None:
        if not isinstance(event.kind, model.ServiceInterfaceFBType):
            return None

        def seen() -> None:
            """Tells the tracer, by being in the queue."""

        self._know(event, seen, is_output=True)
        return seen

    def written(self, time: int, name: str, value: Any) -> None:
        self.end_chain(time)
        self._add(time, self._written(time, name, json.dumps(value)), 1)

    def follow(self, entry: QueueEntry, time: int) -> Path:
        path = self.path
        assert isinstance(path, _Path)
        if entry in path.last:
            self.end_chain(time)
            return self._root[entry] or self.follow(entry, time)
        source = self._sources.get(entry)
        if source is None:
            # what a composite passes on is no event of its own
            path[entry] = path
            return path
        if len(path.sources) == LONGEST or any(_may_change(before, source) for before in path.sources):
            path.last.add(entry)
            return self.follow(entry, time)
        if self._paths == PATHS:
            self.end_chain(time)
            self._forget()
            path = self._root
        self._paths += 1
        longer = path[entry] = _Path((*path.sources, source))
        return longer

    def end_chain(self, time: int) -> None:
        path = self.path
        assert isinstance(path, _Path)
        if path.sources:
            self.path = self._root
            self._add(time, path.encode(time), len(path.sources))

    def flush(self) -> None:
        """Writes what has not been written yet."""
        if self._packet:
            self._writer.write(b"".join(self._packet), self._count, self._first, self._last)
            self._packet.clear()
            self._count = 0

    def _add(self, time: int, records: bytes, count: int) -> None:
        if not self._packet:
            self._first = time
        self._last = time
        self._packet.append(records)
        self._count += count
        if self._count >= PACKET:
            self.flush()

    def _know(self, event: ObservedEvent, entry: QueueEntry, is_output: bool = False) -> None:
        """Records an entry from now on, in place of the one that the event had before the network was changed."""
        fields, expressions = layout(event.variables)
        if isinstance(event.kind, model.BasicFBType):
            fields, expressions = (*fields, CHART_FIELD), (*expressions, "{b}.state__")
        old = self._entries.get(event.name)
        if old is not None:
            del self._sources[old]
        self._entries[event.name] = entry
        self._sources[entry] = _Source(self._writer.kind(event.name, fields), expressions, event.block, is_output)
        self._forget()

    def _forget(self) -> None:
        self._paths = 0
        self.path = self._root = _Path()


class TracedResource(Resource):
    """A resource whose events are recorded from its beginning.

    Args:
        network: what runs.
        library: finds the block types that the network uses.
        writer: writes the trace.
    """

    def __init__(self, network: model.FBNetwork, library: Library, writer: TraceWriter) -> None:
        super().__init__(network, library)
        recorder = Recorder(writer)
        recorder.start(self.time, self.states())
        self.trace(recorder)


def layout(variables: tuple[model.Variable, ...]) -> tuple[tuple[Field, ...], tuple[str, ...]]:
    """The fields of variables, and the Python text of each one's value at the instance `{b}`, `*` before several."""
    fields, values = [], []
    for variable in variables:
        assert not isinstance(variable.type, model.GenericType)
        field, is_plain = _field(variable.name, variable.type)
        fields.append(field)
        text = f"{{b}}.{python_name(variable.name)}"
        values.append(f"{'*' * (field.count != 1)}{text}" if is_plain else f"repr({text})")
    return tuple(fields), tuple(values)


def _encoder(sources: Sequence[_Source]) -> Encode:
    """What gives the bytes of the records of several events."""
    space: dict[str, Any] = {f"b{number}": source.block for number, source in enumerate(sources)}
    events = [
        (source.kind, [expression.format(b=f"b{number}") for expression in source.expressions])
        for number, source in enumerate(sources)
    ]
    encode: Encode = eval(f"lambda time: {encoding(events, space)}", space)
    return encode


def _text_encoder(kind: EventKind) -> Callable[[int, str, str], bytes]:
    space: dict[str, Any] = {}
    encode: Callable[[int, str, str], bytes]
    encode = eval(f"lambda time, name, value: {encoding([(kind, ('name', 'value'))], space)}", space)
    return encode


def _field(name: str, kind: DataType) -> tuple[Field, bool]:
    """The field of a variable, and whether it holds the values themselves and not their text."""
    if isinstance(kind, ArrayType):
        element, is_plain = _field(name, kind.element)
        if isinstance(kind.element, ArrayType) or not is_plain or kind.length == 1:
            return Field(name, TEXT), False
        return Field(name, element.kind, kind.length), True
    meaning = getattr(kind, "kind", "")
    if meaning == "string":
        return Field(name, TEXT), True
    if meaning in ("bool", "signed", "unsigned", "bits", "real", "time"):
        return Field(name, _NAMES.get(kind.name, f"{kind.name.lower()}_t")), True
    return Field(name, TEXT), False
