"""What machine code records of the events of a network: the records of `iec61499.trace`, written by C."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from iec61499 import model
from iec61499.errors import NativeError
from iec61499.native.blocks import STATE
from iec61499.native.layout import Layout
from iec61499.runtime.linking.netlist import Terminal
from iec61499.st.c.names import TEXT as LONGEST_TEXT
from iec61499.st.c.names import c_name, size_of
from iec61499.trace.ctf import TEXT, Field
from iec61499.trace.recorder import CHART_FIELD, layout
from iec61499.types import DataType, ElementaryType

_BYTES, _TEXT, _CHART = range(3)
_HEAD: Final = 10
"""Bytes of a record before its fields."""
_INDENT: Final = "    "


@dataclass(frozen=True, slots=True)
class TracedEvent:
    """An event that is recorded.

    Attributes:
        name: BLOCK.EVENT.
        entry: the number of the queue's entry that stands for it.
        fields: what a record holds.
        pieces: the C lvalue below the unit of each field, and its form.
        longest: most bytes of a record.
    """

    name: str
    entry: int
    fields: tuple[Field, ...]
    pieces: tuple[tuple[str, int], ...]
    longest: int


def traced_outputs(layout: Layout) -> Mapping[Terminal, int]:
    """The event outputs of service blocks and the entries that stand in the queue before those of their receivers."""
    outputs = [
        Terminal(number, event.name)
        for number, node in layout.netlist.nodes.items()
        if isinstance(node.type, model.ServiceInterfaceFBType)
        for event in node.interface.event_outputs
    ]
    return {port: number for number, port in enumerate(outputs, len(layout.entries))}


def traced_events(layout: Layout) -> tuple[TracedEvent, ...]:
    """The events that are recorded. Raises NativeError for data that C does not record as Python does."""
    if sys.byteorder != "little":
        raise NativeError("machine code writes traces on little-endian machines only")
    # what a composite passes on is no event of its own
    inputs = [(port, number) for port, number in layout.entries.items() if not port.inner]
    return tuple(_event(layout, port, number) for port, number in (*inputs, *traced_outputs(layout).items()))


def trace_tables(layout: Layout, name: str) -> list[str]:
    """The C tables of the events, which `fb_record` reads."""
    events = traced_events(layout)
    rows = ["{0, 0, 0}"] * (len(layout.entries) + len(traced_outputs(layout)))
    pieces: list[str] = []
    for number, event in enumerate(events, 1):
        rows[event.entry] = f"{{{number}, {len(pieces)}, {len(event.pieces)}}}"
        for member, form in event.pieces:
            size = f"sizeof(((struct {name} *)0)->{member})"
            pieces.append(f"{{offsetof(struct {name}, {member}), {size}, {form}}}")
    lines = ["", (Path(__file__).parent / "trace.h").read_text()]
    lines += ["static const struct fb_piece fb_pieces[] = {"]
    lines += [f"{_INDENT}{piece}," for piece in pieces or ["{0, 0, 0}"]] + ["};"]
    lines += ["static const struct fb_traced fb_entries[] = {", *(f"{_INDENT}{row}," for row in rows), "};"]
    return [*lines, "enum {", f"{_INDENT}FB_LONGEST_RECORD = {max((e.longest for e in events), default=_HEAD)}", "};"]


def _event(where: Layout, port: Terminal, entry: int) -> TracedEvent:
    node, member = where.netlist.nodes[port.node], where.members[port.node]
    inputs = {event.name: event for event in node.interface.event_inputs}
    if entry < len(where.entries):
        names = [n for n in inputs[port.name].with_variables if Terminal(port.node, n) in where.netlist.data]
        variables = tuple(variable for variable in node.interface.inputs if variable.name in names)
    else:
        event = next(event for event in node.interface.event_outputs if event.name == port.name)
        variables = tuple(v for v in node.interface.outputs if v.name in event.with_variables)
    fields, _ = layout(variables)
    pieces, longest = [], _HEAD
    for field, variable in zip(fields, variables, strict=True):
        assert not isinstance(variable.type, model.GenericType)
        form = _form(f"{node.name}.{variable.name}", field, variable.type)
        pieces.append((f"{member}.{c_name(variable.name)}", form))
        longest += 2 * LONGEST_TEXT + 1 if form == _TEXT else size_of(variable.type)
    if isinstance(node.type, model.BasicFBType) and entry < len(where.entries):
        fields, pieces, longest = (*fields, CHART_FIELD), [*pieces, (f"{member}.{STATE}", _CHART)], longest + 2
    return TracedEvent(f"{node.name}.{port.name}", entry, fields, tuple(pieces), longest)


def _form(name: str, field: Field, data_type: DataType) -> int:
    if field.kind != TEXT:
        return _BYTES
    if not isinstance(data_type, ElementaryType) or data_type.kind != "string":
        raise NativeError(f"{name}: machine code does not record a {data_type}")
    return _TEXT
