"""Compiles a block type once: a class for its instances and a Python function for each event input.

An instance has an attribute for every variable, under its `python_name`. Beside them, with two underscores, which
no IEC identifier contains: `state__`, the chart's state by number; `p__Q`, the value of output Q that the last
event with Q in its WITH has published; `to__CNF`, the queue entries of the event inputs that CNF is connected to;
`extend__`, which appends them to the resource's queue; `name__`, the dotted name. An output that every algorithm
publishes as soon as it has written it needs no `p__` copy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.runtime import communication, timers
from iec61499.runtime.chart import CHAIN_LIMIT, ChartWriter, handler_name
from iec61499.runtime.inner_blocks import add_reactions
from iec61499.runtime.kept.block_text import text_of
from iec61499.runtime.linking.generic_ports import unconnected
from iec61499.runtime.service_interface import EventHandler, ServiceBehaviour
from iec61499.runtime.services import absent, clocked, utilities
from iec61499.st.python.expressions import python_name, wiring_name
from iec61499.st.python.translate import CONDITION_GLOBALS, define_algorithm

PUBLISHED: Final = "p__"


@dataclass(frozen=True, slots=True)
class CompiledType:
    """What instances of a block type are made of.

    Attributes:
        block: the block type, without generic variables.
        instance_class: makes an instance, with the attributes that this module's docstring lists.
        handlers: the handler of every event input; empty for a composite.
        published: the attribute that holds the published value of every data output.
        initial: the attributes that make up the state, with the values they start with.
        save: takes the state's values out of an instance; values are never changed in place.
        load: puts the state's values back into an instance.
        behaviour: what a service interface block does; None for other types.
    """

    block: model.FBType
    instance_class: Callable[[], Any]
    handlers: Mapping[str, EventHandler]
    published: Mapping[str, str]
    initial: Mapping[str, Any]
    save: Callable[[Any], tuple[Any, ...]]
    load: Callable[[Any, tuple[Any, ...]], None]
    behaviour: ServiceBehaviour | None = None


def compile_type(block: model.FBType) -> CompiledType:
    """Compiles a block type whose variables have elementary or array types; the result is kept for the next one.

    Raises:
        FunctionBlockError: an algorithm or condition is wrong, or the block has an interface only; names file, line
            and column.
    """
    found = compiled(block)
    if isinstance(found, FunctionBlockError):
        raise found.with_traceback(None)
    return found


@lru_cache(maxsize=1024)
def compiled(block: model.FBType) -> CompiledType | FunctionBlockError:
    try:
        if isinstance(block, model.BasicFBType | model.SimpleFBType):
            return _Algorithmic(block).compile()
        if isinstance(block, model.CompositeFBType):
            return _assemble(block, {}, _immediate(block), {})
        behaviour = _behaviour(block)
        return _assemble(block, behaviour.handlers, _immediate(block), behaviour.state, behaviour)
    except FunctionBlockError as error:
        return error.with_traceback(None)


def _behaviour(block: model.ServiceInterfaceFBType) -> ServiceBehaviour:
    behaviour = _service(block) or absent.behaviour(block)
    if behaviour is None:
        lacks = (
            "a service of hardware or of a module that this device does not have, and without QO or STATUS to say so"
        )
        if block.header.name in ("STRUCT_MUX", "STRUCT_DEMUX"):
            lacks = "its ports are the members of a structure, which the attribute StructuredType of the block names"
        raise FunctionBlockError(
            f"block type {block.header.name} has an interface but no behaviour: {lacks}",
            block.header.file,
            block.header.line,
        )
    return behaviour


def _service(block: model.ServiceInterfaceFBType) -> ServiceBehaviour | None:
    name = block.header.name
    return (
        timers.BEHAVIOURS.get(name)
        or clocked.BEHAVIOURS.get(name)
        or communication.behaviour(block)
        or utilities.behaviour(block)
    )


def has_no_service(block: model.ServiceInterfaceFBType) -> bool:
    """Whether this runtime does not do what the block's interface promises."""
    return _service(unconnected(block)) is None


def _immediate(block: model.FBType) -> dict[str, str]:
    """Outputs that are published as soon as they change."""
    return {variable.name: python_name(variable.name) for variable in block.interface.outputs}


def _assemble(
    block: model.FBType,
    handlers: Mapping[str, EventHandler],
    published: Mapping[str, str],
    state: Mapping[str, Any],
    behaviour: ServiceBehaviour | None = None,
) -> CompiledType:
    interface = block.interface
    initial: dict[str, Any] = {}
    for variable in (*interface.inputs, *interface.outputs, *getattr(block, "internals", ())):
        value = model.initial_value(variable, block.header.file)
        initial[python_name(variable.name)] = value
        initial[published.get(variable.name, python_name(variable.name))] = value
    initial |= state
    wiring = [wiring_name(event.name) for event in interface.event_outputs]
    if behaviour is not None:
        wiring += behaviour.wiring
    slots = (*initial, *wiring, "extend__", "name__", "resource__")
    instance_class = type(block.header.name, (), {"__slots__": slots})
    return CompiledType(block, instance_class, handlers, published, initial, *_memory(initial), behaviour)


def _memory(
    attributes: Iterable[str],
) -> tuple[Callable[[Any], tuple[Any, ...]], Callable[[Any, tuple[Any, ...]], None]]:
    """Functions that take the named attributes of an instance, and put them back."""
    names = "".join(f"s.{attribute}, " for attribute in attributes) or "()"
    space: dict[str, Any] = {}
    source = f"def save(s):\n    return {names}\ndef load(s, values):\n    {names} = values"
    exec(compile(source, "<memory>", "exec"), space)
    return space["save"], space["load"]


class _Algorithmic:
    """Compiles basic and simple blocks."""

    def __init__(self, block: model.BasicFBType | model.SimpleFBType) -> None:
        self._block = block
        self._with = {event.name: event.with_variables for event in block.interface.event_outputs}

    def compile(self) -> CompiledType:
        block = self._block
        text = text_of(block)
        names = {algorithm: f"algorithm_{number}" for number, algorithm in enumerate(text.algorithms)}
        space: dict[str, Any] = {**CONDITION_GLOBALS, "endless_chain": _endless_chain}
        inner_state = add_reactions(block, space)
        for algorithm, code in text.algorithms.items():
            space[names[algorithm]] = define_algorithm(code, f"{block.header.name}.{algorithm}", space)
        published = {
            variable.name: (PUBLISHED if variable.name in text.late else "") + python_name(variable.name)
            for variable in block.interface.outputs
        }
        actions = {state.name: self._action_lines(state, names, published) for state in block.states}
        events = [event.name for event in block.interface.event_inputs]
        if isinstance(block, model.BasicFBType):
            guards = dict(zip((t for t in block.transitions if t.guard), text.guards, strict=True))
            lines = ChartWriter(block.states, block.transitions, guards, actions).write(events)
            state = {"state__": 0}
        else:
            lines = []
            for event in events:
                lines += [
                    f"def {handler_name(event)}(s):",
                    *("    " + line for line in actions.get(event) or ["pass"]),
                ]
            state = {}
        exec(compile("\n".join(lines), f"<{block.header.name}>", "exec"), space)
        handlers = {event: space[handler_name(event)] for event in events}
        return _assemble(block, handlers, published, state | inner_state)

    def _action_lines(
        self, state: model.ECState, names: Mapping[str, str], published: Mapping[str, str]
    ) -> list[str]:
        lines = []
        for action in state.actions:
            if action.algorithm:
                lines.append(f"{names[action.algorithm]}(s)")
            if action.output:
                for output in self._with[action.output]:
                    attribute = python_name(output)
                    if published[output] != attribute:
                        lines.append(f"s.{published[output]} = s.{attribute}")
                lines.append(f"s.extend__(s.{wiring_name(action.output)})")
        return lines


def _endless_chain(instance: Any) -> None:
    raise FunctionBlockError(
        f"{instance.name__}: more than {CHAIN_LIMIT} transitions without an event: the chart never comes to rest"
    )
