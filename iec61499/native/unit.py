"""A flat network to one reentrant C99 unit without allocation, its state in one structure.

Events wait in one queue, first in first out, as in the Python runtime. An entry of the queue samples the inputs of a
block that are WITH the event and executes the block; composites have entries for what enters and leaves them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Final

from iec61499 import model
from iec61499.native import clock
from iec61499.native.blocks import OUTPUTS, BlockCode, block_code, block_fields, structure
from iec61499.native.heads import Heads, structures, values_of
from iec61499.native.layout import Layout, is_server
from iec61499.native.services import ANSWERS, ATTACHED, OPEN, TIMER, service_code
from iec61499.native.tracing import trace_tables, traced_outputs
from iec61499.runtime.linking.generic_ports import variable_at
from iec61499.runtime.linking.netlist import Node, Terminal
from iec61499.st.ast import Position
from iec61499.st.c.expressions import Places
from iec61499.st.c.names import c_name, c_type, initialiser, quoted
from iec61499.st.c.translate import moved
from iec61499.types import ElementaryType

_INDENT: Final = "    "
PART: Final = 512
"""Entries that one function delivers; compilers take too long for much longer ones."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A C unit.

    Attributes:
        header: text of NAME.h.
        source: text of NAME.c.
    """

    header: str
    source: str


def unit_of(layout: Layout, name: str, traced: bool = False, hosted: bool = False) -> Unit:
    """The C unit of a network.

    Args:
        layout: its layout.
        name: a C identifier that begins the names that the unit has for others.
        traced: whether it can record its events.
        hosted: whether a host does what other services than restart and timers do.

    Raises:
        FunctionBlockError: a block is wrong, or needs what C cannot do; names file and line, and in Structured Text
            the column.
        NativeError: the events cannot be recorded by C.
    """
    return _Writer(layout, name, traced, hosted).unit()


class _Writer:
    def __init__(self, layout: Layout, name: str, traced: bool, hosted: bool) -> None:
        self._layout = layout
        self._traced = traced
        self._hosted = hosted
        self._timers = {number: k for k, number in enumerate(clock.timed(layout))}
        self._nodes = layout.netlist.nodes
        self._name = name
        self._heads = Heads(layout, name, hosted)
        self._places = Places()
        self._places.number(Position("", 0, 0))
        self._types: dict[str, BlockCode] = {}
        for node, tag in zip(self._nodes.values(), layout.tags, strict=True):
            if tag not in self._types:
                self._types[tag] = self._code(node, tag)

    def _code(self, node: Node, tag: str) -> BlockCode:
        block = node.type
        assert block is not None
        if isinstance(block, model.BasicFBType | model.SimpleFBType):
            return block_code(block, tag, self._places)
        if isinstance(block, model.ServiceInterfaceFBType):
            return service_code(block, tag, node, self._hosted)
        published = {variable.name: c_name(variable.name) for variable in block.interface.outputs}
        return BlockCode(tag, block_fields(block), False, (), {}, published)

    def unit(self) -> Unit:
        source = [
            f'#include "{self._name}.h"',
            *self._wiring(),
            *(line for code in self._types.values() for line in code.lines),
            *(trace_tables(self._layout, self._name) if self._traced else ()),
            *self._delivery(),
            *self._initial(),
            *self._interface(),
            *self._tables(),
        ]
        return Unit(_text(self._header()), _text(source))

    def _header(self) -> list[str]:
        name = self._name
        guard = f"DTWIN_{name.upper()}_H"
        members = [f"struct {t} {m};" for t, m in zip(self._layout.tags, self._layout.members, strict=True)]
        aggregates = structures(place.type for place in self._layout.variables)
        lines = [f"/* The function blocks of {name}; written by `dtwin fb export --format c`. */"]
        lines += [f"#ifndef {guard}", f"#define {guard}", "", *clock.sizes(self._layout), '#include "fb.h"']
        lines += [*clock.checked_sizes(self._layout), *aggregates]
        for code in self._types.values():
            lines += ["", *structure(code)]
        lines += ["", "/* The state of all blocks; a copy of it is a snapshot. */", f"struct {name} {{"]
        if self._traced:
            members.append("struct fb_trace *trace__;")
        lines += [*_indented(["struct fb_run run;", *members]), "};"]
        for number in self._heads.servers():
            lines += ["", *self._heads.messages(number)]
        lines += ["", "/* Puts every variable and chart to its beginning. */", f"{self._heads.initialise()};"]
        lines += [
            "",
            "/* Issues COLD, WARM or STOP of every E_RESTART, runs until idle; returns an fb_problem. */",
        ]
        lines += [f"{self._heads.start(event)};" for event in ("COLD", "WARM", "STOP")]
        lines += ["", "/* Delivers an event, by its number, and runs until idle; returns an fb_problem. */"]
        lines += [f"{self._heads.trigger()};", "", "/* Delivers the events that wait; returns an fb_problem. */"]
        lines += [
            f"int32_t {name}__run(struct {name} *unit);",
            *clock.heads(name),
            "",
            "/* A message to a SERVER, whose IND then waits. */",
        ]
        lines += [f"{self._heads.deliver(number)};" for number in self._heads.servers()]
        lines += ["", "/* A message to a SERVER, and its answer; returns an fb_problem. */"]
        lines += [f"{self._heads.exchange(number)};" for number in self._heads.servers()]
        lines += ["", "/* Every variable by its name; reading and writing one is copying it from or to its place. */"]
        lines += [f"extern const struct fb_variable {name}__variables[];", f"extern const size_t {name}__count;"]
        lines += [f"extern const size_t {name}__size;", f"extern const char *const {name}__events[];"]
        if self._traced:
            lines += ["struct fb_trace;", f"void {name}__trace(struct {name} *unit, struct fb_trace *trace);"]
        lines += [f"extern const struct fb_place {name}__places[];"]
        lines += [f"const struct fb_variable *{name}__find(const char *variable);"]
        lines += [f"void {name}__read(const struct {name} *unit, const struct fb_variable *variable, void *value);"]
        lines += [f"void {name}__write(struct {name} *unit, const struct fb_variable *variable, const void *value);"]
        return [*lines, "", "#endif"]

    def _wiring(self) -> list[str]:
        """The tables of what every event output leads to, and what queues it."""
        layout = self._layout
        targets: list[list[int]] = [[] for _ in range(layout.outputs[-1] + len(layout.inner))]
        for port, entry in traced_outputs(layout).items() if self._traced else ():
            targets[self._output(port)].append(entry)
        for wire in layout.netlist.events:
            targets[self._output(wire.source)].append(layout.entries[wire.destination])
        first = [0]
        for ends in targets:
            first.append(first[-1] + len(ends))
        numbers = [end for ends in targets for end in ends] or [0]
        return [
            "",
            f"static const uint16_t fb_first[] = {{{', '.join(map(str, first))}}};",
            f"static const uint16_t fb_targets[] = {{{', '.join(map(str, numbers))}}};",
            "",
            "static void fb_issue(struct fb_run *run, int32_t output)",
            "{",
            *_indented(
                [
                    "uint16_t k;",
                    "for (k = fb_first[output]; k < fb_first[output + 1]; ++k) {",
                    f"{_INDENT}fb_push(run, fb_targets[k]);",
                    "}",
                ]
            ),
            "}",
        ]

    def _output(self, port: Terminal) -> int:
        if port.inner:
            return self._layout.inner[port]
        events = [event.name for event in self._nodes[port.node].interface.event_outputs]
        return self._layout.outputs[port.node] + events.index(port.name)

    def _delivery(self) -> list[str]:
        name = self._name
        cases: list[list[str]] = []
        for port, number in self._layout.entries.items():
            head = f"{_INDENT}case {number}: /* {self._nodes[port.node].name}.{port.name} */"
            cases.append([head, *_indented(_indented([*self._entry(port), "break;"]))])
        parts = [cases[first : first + PART] for first in range(0, len(cases), PART)] or [[]]
        lines: list[str] = []
        for number, part in enumerate(parts if len(parts) > 1 else ()):
            lines += self._switch(f"{name}__deliver_{number}", "entry", part)
        if len(parts) > 1:
            called = [f"{name}__deliver_{number}(unit, entry);" for number in range(len(parts))]
            cases = [[f"{_INDENT}case {k}:", *_indented(_indented([c, "break;"]))] for k, c in enumerate(called)]
            lines += self._switch(f"{name}__deliver", f"entry / {PART}", cases, self._traced)
        else:
            lines += self._switch(f"{name}__deliver", "entry", parts[0], self._traced)
        run = f"""
int32_t {name}__run(struct {name} *unit)
{{
    struct fb_run *run = &unit->run;
    uint32_t events;
    for (events = 0; run->waiting > 0 && fb_fine(run); ++events) {{
        const uint16_t entry = fb_pop(run);
        run->fault.event = entry;
        if (events == FB_EVENTS) {{
            fb_fail(run, FB_ENDLESS_EVENTS, 0);
        }} else {{
            {name}__deliver(unit, entry);
        }}
    }}
    run->waiting = 0;
    run->iterations = FB_ITERATIONS;
    return run->fault.problem;
}}
"""
        return [*lines, *run.splitlines()]

    def _switch(self, function: str, value: str, cases: list[list[str]], traced: bool = False) -> list[str]:
        """A function that delivers what the cases say, and records it."""
        lines = ["", f"static void {function}(struct {self._name} *unit, uint16_t entry)", "{"]
        lines += [f"{_INDENT}switch ({value}) {{", *(line for case in cases for line in case)]
        lines += _indented(["default:", f"{_INDENT}break;", "}"])
        if traced:
            lines.append(
                f"{_INDENT}fb_record(unit->trace__, unit, &fb_entries[entry], fb_pieces, FB_LONGEST_RECORD);"
            )
        return [*lines, "}"]

    def _entry(self, port: Terminal) -> list[str]:
        node, member = self._nodes[port.node], self._layout.members[port.node]
        if port.inner:
            event = next(e for e in node.interface.event_outputs if e.name == port.name)
            copies = self._copies(port.node, event.with_variables, inner=True)
            return [*copies, f"fb_issue(&unit->run, {self._output(Terminal(port.node, port.name))});"]
        event = next(e for e in node.interface.event_inputs if e.name == port.name)
        copies = self._copies(port.node, event.with_variables, inner=False)
        if isinstance(node.type, model.CompositeFBType):
            inner = Terminal(port.node, port.name, inner=True)
            return [*copies, f"fb_issue(&unit->run, {self._output(inner)});"]
        handler = self._types[self._layout.tags[port.node]].handlers[port.name]
        return [*copies, f"{handler}(&unit->{member}, &unit->run);"]

    def _copies(self, number: int, names: Sequence[str], inner: bool) -> list[str]:
        lines = []
        for name in names:
            wire = self._layout.netlist.data.get(Terminal(number, name, inner))
            if wire is None:
                continue
            source = wire.source
            member = (
                c_name(source.name)
                if source.inner
                else self._types[self._layout.tags[source.node]].published[source.name]
            )
            target = f"unit->{self._layout.members[number]}.{c_name(name)}"
            lines += _widened(
                target,
                f"unit->{self._layout.members[source.node]}.{member}",
                variable_at(self._nodes[source.node], source.name).type,
                variable_at(self._nodes[number], name).type,
            )
        return lines

    def _initial(self) -> list[str]:
        name = self._name
        lines = [
            "",
            f"static const struct {name} fb_initial = {{",
            f"{_INDENT}.run = {{.iterations = FB_ITERATIONS}},",
        ]
        for number, node in self._nodes.items():
            values = [f".{OUTPUTS} = {self._layout.outputs[number]}"]
            if number in self._timers:
                values.append(f".{TIMER} = {self._timers[number]}")
            parameters = {c_name(key): value for key, value in node.parameters.items()}
            for field in self._types[self._layout.tags[number]].fields:
                value = field.initial
                if field.name in parameters:
                    parameter = parameters[field.name]
                    value = model.literal(parameter.value, field.type, node.file, parameter.line)
                text = initialiser(value, field.type)
                if text not in ("0", "0.0", "0.0f", "false", '{0, ""}'):
                    values.append(f".{field.name} = {text}")
            lines += [f"{_INDENT}.{self._layout.members[number]} = {{"]
            lines += [f"{_INDENT * 2}{value}," for value in values] + [f"{_INDENT}}},"]
        return [*lines, "};"]

    def _interface(self) -> list[str]:
        name = self._name
        lines = ["", self._heads.initialise(), "{", f"{_INDENT}*unit = fb_initial;", "}"]
        for event in ("COLD", "WARM", "STOP"):
            issued = [
                f"fb_issue(&unit->run, {self._output(Terminal(number, event))});"
                for number, node in self._nodes.items()
                if node.type is not None and node.type.header.name == "E_RESTART"
            ]
            lines += ["", self._heads.start(event), "{", f"{_INDENT}unit->run.fault.problem = FB_FINE;"]
            lines += [*_indented(issued), f"{_INDENT}return {name}__run(unit);", "}"]
        lines += ["", self._heads.trigger(), "{", f"{_INDENT}unit->run.fault.problem = FB_FINE;"]
        lines += [f"{_INDENT}fb_push(&unit->run, entry);", f"{_INDENT}return {name}__run(unit);", "}"]
        lines += clock.functions(self._layout, name)
        for number in self._heads.servers():
            lines += ["", self._heads.deliver(number), "{", *_indented(self._delivered(number)), "}"]
            lines += ["", self._heads.exchange(number), "{", *_indented(self._exchanged(number)), "}"]
        return lines

    def _delivered(self, number: int) -> list[str]:
        node, block = self._nodes[number], f"unit->{self._layout.members[number]}"
        outputs = [event.name for event in node.interface.event_outputs]
        lines = ["unit->run.fault.problem = FB_FINE;", "(void)request;", f"if (!{block}.{OPEN}) {{"]
        lines += [f"{_INDENT}return FB_NOT_OPEN;", "}", f"{block}.{ANSWERS} = 0;"]
        for name, kind in values_of(node, "RD_"):
            lines += moved(f"{block}.{name}", f"request->{name}", kind)
        lines += [f"{block}.QO = true;", f'fb_assign(&{block}.STATUS, fb_literal("OK", 2));']
        lines += [f"fb_issue(&unit->run, {self._layout.outputs[number] + outputs.index('IND')});"]
        return [*lines, "return unit->run.fault.problem;"]

    def _exchanged(self, number: int) -> list[str]:
        node, member = self._nodes[number], self._layout.members[number]
        block = f"unit->{member}"
        lines = [f"int32_t problem = {self._name}__deliver__{member}(unit, request);"]
        lines += ["if (problem != FB_FINE) {", f"{_INDENT}return problem;", "}"]
        lines += [f"problem = {self._name}__run(unit);", f"if (problem == FB_FINE && {block}.{ANSWERS} != 1) {{"]
        lines += [*_indented([f"unit->run.fault.value = {block}.{ANSWERS};", "problem = FB_NO_ANSWER;"]), "}"]
        for name, kind in values_of(node, "SD_"):
            lines += moved(f"answer->{name}", f"{block}.{name}", kind)
        return [*lines, "return problem;"]

    def _tables(self) -> list[str]:
        name = self._name
        lines = ["", f"const struct fb_variable {name}__variables[] = {{"]
        for place in self._layout.variables:
            where = f"offsetof(struct {name}, {place.member}), sizeof(((struct {name} *)0)->{place.member})"
            lines.append(f"{_INDENT}{{{quoted(place.name)}, {quoted(str(place.type))}, {where}}},")
        for number, node in self._nodes.items():
            if is_server(node) and not self._hosted:
                for member in (OPEN, ATTACHED):
                    where = f"offsetof(struct {name}, {self._layout.members[number]}.{member}), sizeof(bool)"
                    lines.append(f'{_INDENT}{{"", "BOOL", {where}}},')
        lines += ["};", f"const size_t {name}__count = {len(self._layout.variables)};"]
        lines += [f"const size_t {name}__size = sizeof(struct {name});", f"const char *const {name}__events[] = {{"]
        lines += [f"{_INDENT}{quoted(event)}," for event in self._layout.event_names] + ["};"]
        lines += [f"const struct fb_place {name}__places[] = {{"]
        lines += [f"{_INDENT}{{{quoted(PurePath(at[0]).name)}, {at[1]}, {at[2]}}}," for at in self._places.found] + [
            "};"
        ]
        access = f"""
const struct fb_variable *{name}__find(const char *variable)
{{
    size_t k;
    for (k = 0; k < {name}__count; ++k) {{
        if (strcmp({name}__variables[k].name, variable) == 0) {{
            return &{name}__variables[k];
        }}
    }}
    return NULL;
}}

void {name}__read(const struct {name} *unit, const struct fb_variable *variable, void *value)
{{
    memcpy(value, (const char *)unit + variable->offset, variable->size);
}}

void {name}__write(struct {name} *unit, const struct fb_variable *variable, const void *value)
{{
    memcpy((char *)unit + variable->offset, value, variable->size);
}}
"""
        if self._traced:
            lines += ["", f"void {name}__trace(struct {name} *unit, struct fb_trace *trace)"]
            lines += ["{", f"{_INDENT}unit->trace__ = trace;", "}"]
        return [*lines, *access.splitlines()]


def _widened(target: str, source: str, given: model.VariableType, wanted: model.VariableType) -> list[str]:
    """The assignment of a connection, with its implicit widening."""
    assert not isinstance(wanted, model.GenericType)
    if given == wanted or not isinstance(wanted, ElementaryType) or wanted.kind == "string":
        return moved(target, source, wanted)
    return [f"{target} = ({c_type(wanted)}){source};"]


def _indented(lines: Iterable[str]) -> list[str]:
    return [_INDENT + line if line else line for line in lines]


def _text(lines: Iterable[str]) -> str:
    return "".join(f"{line}\n" for line in lines)
