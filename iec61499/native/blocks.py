"""Basic and simple block types to C: a structure, a function for every algorithm, and one for every event input."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.runtime.checker import BlockChecker
from iec61499.runtime.publication import late_outputs
from iec61499.st.ast import Position
from iec61499.st.c.expressions import Places
from iec61499.st.c.names import c_name, check_supported, declaration
from iec61499.st.c.translate import CCondition, CFunction, c_condition, c_function, moved
from iec61499.types import DataType

LATE: Final = "late__"
"""Begins the name of the member that holds what an output has published."""
STATE: Final = "chart__"
"""The member that holds the chart's state by its number."""
OUTPUTS: Final = "outputs__"
"""The member that holds the number of the instance's first event output."""
_INDENT: Final = "    "


@dataclass(frozen=True, slots=True)
class Field:
    """A member of a block's structure: its C name, type and the value that it starts with."""

    name: str
    type: DataType
    initial: Any


@dataclass(frozen=True, slots=True)
class BlockCode:
    """What is generated for a block type.

    Attributes:
        tag: the name of its structure, which begins the names of its functions.
        fields: the variables of an instance.
        has_chart: whether an instance has a state.
        lines: definitions of its functions.
        handlers: the function of every event input.
        published: the member that holds the published value of every data output.
    """

    tag: str
    fields: tuple[Field, ...]
    has_chart: bool
    lines: tuple[str, ...]
    handlers: Mapping[str, str]
    published: Mapping[str, str]


def block_fields(block: model.FBType) -> tuple[Field, ...]:
    """The variables of a block type. Raises FunctionBlockError for a type or variable that C does not have."""
    file = block.header.file
    fields = []
    for name in block.interface.in_outs:
        raise FunctionBlockError(f"C: the VAR_IN_OUT {name} is not supported", file)
    for inner in block.blocks if isinstance(block, model.BasicFBType | model.SimpleFBType) else ():
        raise FunctionBlockError(f"C: the block {inner.name} inside another one is not supported", file, inner.line)
    for variable in (*block.interface.inputs, *block.interface.outputs, *getattr(block, "internals", ())):
        assert not isinstance(variable.type, model.GenericType)
        check_supported(variable.type, Position(file, variable.line, 0))
        initial = model.initial_value(variable, file)
        fields.append(Field(c_name(variable.name), variable.type, initial))
    return tuple(fields)


def block_code(block: model.BasicFBType | model.SimpleFBType, tag: str, places: Places) -> BlockCode:
    """The C code of a block type.

    Args:
        block: the block type, without generic variables.
        tag: the name of its structure.
        places: collects the places of faults.

    Raises:
        FunctionBlockError: the block is wrong, or needs what C cannot do; names file, line and column.
    """
    return _Writer(block, tag, places).code()


def structure(code: BlockCode) -> list[str]:
    """The definition of a block's structure."""
    members = [f"{declaration(field.name, field.type)};" for field in code.fields]
    if code.has_chart:
        members.insert(0, f"int32_t {STATE};")
    members.insert(0, f"uint16_t {OUTPUTS};")
    return [f"struct {code.tag} {{", *_indented(members), "};"]


class _Writer:
    def __init__(self, block: model.BasicFBType | model.SimpleFBType, tag: str, places: Places) -> None:
        self._block = block
        self._tag = tag
        self._places = places
        self._checker = BlockChecker(block)
        self._outputs = {event.name: n for n, event in enumerate(block.interface.event_outputs)}
        self._with = {event.name: event.with_variables for event in block.interface.event_outputs}
        self._algorithms: dict[str, CFunction] = {}
        self._guards: dict[model.ECTransition, CCondition] = {}

    def code(self) -> BlockCode:
        block = self._block
        checked = {algorithm.name: self._checker.algorithm(algorithm) for algorithm in block.algorithms}
        used = {action.algorithm for state in block.states for action in state.actions if action.algorithm}
        self._algorithms = {
            name: c_function(code, self._signature(f"algorithm__{name}"), self._places)
            for name, code in checked.items()
            if name in used
        }
        late = late_outputs(block, checked)
        fields = list(block_fields(block))
        for variable in block.interface.outputs:
            if variable.name in late:
                assert not isinstance(variable.type, model.GenericType)
                initial = model.initial_value(variable, block.header.file)
                fields.append(Field(LATE + c_name(variable.name), variable.type, initial))
        self._late = {variable.name: variable.type for variable in block.interface.outputs if variable.name in late}
        lines = [line for code in self._algorithms.values() for line in ("", *code.lines)]
        events = [event.name for event in block.interface.event_inputs]
        if isinstance(block, model.BasicFBType):
            self._guards = {
                t: c_condition(self._checker.guard(t), self._places) for t in block.transitions if t.guard
            }
            lines += self._chart(events)
        else:
            actions = {state.name: state for state in block.states}
            for event in events:
                body = self._actions(actions[event]) if event in actions else []
                lines += self._function(f"event__{event}", body)
        return BlockCode(
            self._tag,
            tuple(fields),
            isinstance(block, model.BasicFBType),
            tuple(lines),
            {event: self._name(f"event__{event}") for event in events},
            {
                variable.name: (LATE if variable.name in late else "") + c_name(variable.name)
                for variable in block.interface.outputs
            },
        )

    def _name(self, name: str) -> str:
        return f"{self._tag}__{name.replace('.', '__')}"

    def _signature(self, name: str, more: str = "") -> str:
        return f"static void {self._name(name)}(struct {self._tag} *self, struct fb_run *run{more})"

    def _function(self, name: str, body: list[str], more: str = "") -> list[str]:
        text = "\n".join(body)
        unused = [f"(void){argument};" for argument in ("self", "run") if not re.search(rf"\b{argument}\b", text)]
        return ["", self._signature(name, more), "{", *_indented([*unused, *body]), "}"]

    def _chart(self, events: Iterable[str]) -> list[str]:
        states = [f"{self._state(state.name)} = {number}" for number, state in enumerate(self._block.states)]
        lines = ["", "enum {", *_indented([f"{state}," for state in states[:-1]] + states[-1:]), "};"]
        functions = [line for event in events for line in self._event(event)]
        if any(self._name("enter") in line for line in functions):
            lines += self._enter()
        return lines + functions

    def _state(self, name: str) -> str:
        return self._name(f"state__{name}")

    def _enter(self) -> list[str]:
        """The function that enters a state and follows transitions without an event until none fires."""
        cases: list[str] = []
        for state in self._block.states:
            leaving = [t for t in self._leaving(state.name) if not t.event]
            cases += [f"case {self._state(state.name)}:", *_indented(self._actions(state))]
            cases += _indented(self._transitions(leaving, lambda t: [f"state = {self._state(t)};", "continue;"]))
            cases += [f"{_INDENT}break;"]
        place = self._places.number(Position(self._block.header.file, self._block.header.line, 0))
        body = ["switch (state) {", *cases, "default:", f"{_INDENT}break;", "}", f"self->{STATE} = state;"]
        if any(line.strip() == "continue;" for line in cases):
            loop = "for (count = 0; count < FB_TRANSITIONS; ++count) {"
            body = ["int32_t count;", loop, *_indented([*body, "return;"]), "}"]
            body.append(f"fb_fail(run, FB_ENDLESS_CHART, {place});")
        return self._function("enter", body, ", int32_t state")

    def _event(self, event: str) -> list[str]:
        """The function of an event input: the first transition, tried in the state in which the chart is."""
        cases: list[str] = []
        for state in self._block.states:
            leaving = [t for t in self._leaving(state.name) if t.event in ("", event)]
            if not leaving:
                continue
            lines = self._transitions(leaving, self._entering)
            cases += [f"case {self._state(state.name)}:", *_indented([*lines, "break;"])]
        if not cases:
            return self._function(f"event__{event}", [])
        switch = [f"switch (self->{STATE}) {{", *cases, "default:", f"{_INDENT}break;", "}"]
        return self._function(f"event__{event}", switch)

    def _entering(self, state: str) -> list[str]:
        return [f"{self._name('enter')}(self, run, {self._state(state)});"]

    def _leaving(self, state: str) -> list[model.ECTransition]:
        assert isinstance(self._block, model.BasicFBType)
        return [t for t in self._block.transitions if t.source == state]

    def _check_guard(self, transition: model.ECTransition, guard: CCondition) -> None:
        if guard.locals:
            raise FunctionBlockError(
                f"C: condition {transition.guard!r} is not supported: compute it in an algorithm",
                self._block.header.file,
                transition.line,
            )

    def _transitions(self, leaving: Iterable[model.ECTransition], take: Callable[[str], list[str]]) -> list[str]:
        lines: list[str] = []
        for transition in leaving:
            guard = self._guards.get(transition)
            if guard is not None:
                self._check_guard(transition, guard)
            taken = take(transition.destination)
            if guard is None:
                return [*lines, "} else {", *_indented(taken), "}"] if lines else taken
            condition = guard.text if not guard.can_fail else f"({guard.text}) && fb_fine(run)"
            lines += [f"{'} else ' if lines else ''}if ({condition}) {{", *_indented(taken)]
            if guard.can_fail:
                lines += ["} else if (!fb_fine(run)) {", f"{_INDENT}return;"]
        return [*lines, "}"] if lines else []

    def _actions(self, state: model.ECState) -> list[str]:
        lines = []
        for action in state.actions:
            if action.algorithm:
                lines.append(f"{self._name(f'algorithm__{action.algorithm}')}(self, run);")
                if self._algorithms[action.algorithm].can_fail:
                    lines += ["if (!fb_fine(run)) {", f"{_INDENT}return;", "}"]
            if action.output:
                for output in self._with[action.output]:
                    if output in self._late:
                        data_type = self._late[output]
                        assert not isinstance(data_type, model.GenericType)
                        name = c_name(output)
                        lines += moved(f"self->{LATE}{name}", f"self->{name}", data_type)
                number = self._outputs[action.output]
                lines.append(f"fb_issue(run, self->{OUTPUTS} + {number}); /* {action.output} */")
        return lines


def _indented(lines: Iterable[str]) -> list[str]:
    return [_INDENT + line if line else line for line in lines]
