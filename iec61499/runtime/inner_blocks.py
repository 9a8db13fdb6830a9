"""The blocks inside a basic or simple block: functions over the instance of the one that they are in.

Their variables and chart states are attributes of that instance, so that they belong to its state. They react at once
when an algorithm lets them; their output events go nowhere, as in 4diac FORTE.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.runtime.chart import ChartWriter, handler_name
from iec61499.runtime.checker import BlockChecker
from iec61499.runtime.service_interface import EventHandler
from iec61499.runtime.services import clocked
from iec61499.st import typed
from iec61499.st.python.expressions import python_name, reaction_name
from iec61499.st.python.translate import compile_algorithm, compile_condition


def add_reactions(
    block: model.BasicFBType | model.SimpleFBType, space: dict[str, Any], prefix: str = ""
) -> dict[str, Any]:
    """Adds the functions of the blocks inside a block, under their `reaction_name`.

    Args:
        block: the block.
        space: what the functions may call; takes them.
        prefix: the names of the blocks around, each with a point.

    Returns:
        Further attributes that belong to the instance's state, with the values that they start with.

    Raises:
        FunctionBlockError: the text of a block inside is wrong, or a service that cannot stand there.
    """
    state: dict[str, Any] = {}
    for inner in block.blocks:
        path = prefix + inner.name
        kind = inner.type
        if isinstance(kind, model.BasicFBType | model.SimpleFBType):
            state |= add_reactions(kind, space, f"{path}.")
            state |= _algorithmic(kind, path, space)
        else:
            state |= _service(kind, path, space, block, inner.line)
    return state


def _algorithmic(kind: model.BasicFBType | model.SimpleFBType, path: str, space: dict[str, Any]) -> dict[str, Any]:
    checker, under = BlockChecker(kind), reaction_name(path, "").removesuffix("on_")
    own = {variable.name for variable in (*kind.interface.inputs, *kind.interface.outputs, *kind.internals)}
    renamed = {name: f"{path}.{name}" for name in own} | {inner.name: f"{path}.{inner.name}" for inner in kind.blocks}
    actions: dict[str, list[str]] = {}
    for algorithm in kind.algorithms:
        code = _renamed(checker.algorithm(algorithm), renamed)
        space[f"{under}do_{algorithm.name}"] = compile_algorithm(code, f"{kind.header.name}.{algorithm.name}", space)
    for state in kind.states:
        actions[state.name] = [f"{under}do_{action.algorithm}(s)" for action in state.actions if action.algorithm]
    events = [event.name for event in kind.interface.event_inputs]
    if isinstance(kind, model.BasicFBType):
        guards = {t: compile_condition(_renamed(checker.guard(t), renamed)) for t in kind.transitions if t.guard}
        lines = ChartWriter(kind.states, kind.transitions, guards, actions, under).write(events)
    else:
        lines = []
        for event in events:
            lines += [
                f"def {handler_name(event, under)}(s):",
                *("    " + line for line in actions.get(event) or ["pass"]),
            ]
    exec(compile("\n".join(lines), f"<{kind.header.name}>", "exec"), space)
    return {f"{under}state__": 0} if isinstance(kind, model.BasicFBType) else {}


def _renamed(node: Any, names: Mapping[str, str]) -> Any:
    """A checked algorithm or expression over the variables of the block around."""
    if isinstance(node, tuple) and not hasattr(node, "_fields"):
        return tuple(_renamed(part, names) for part in node)
    if isinstance(node, typed.CheckedAlgorithm):
        variables = {names.get(name, name): data_type for name, data_type in node.variables.items()}
        return replace(node, body=_renamed(node.body, names), variables=variables)
    if not is_dataclass(node) or isinstance(node, type) or type(node).__module__ != typed.__name__:
        return node
    parts = {field.name: _renamed(getattr(node, field.name), names) for field in fields(node)}
    if isinstance(node, typed.Load | typed.Element | typed.Store | typed.For | typed.Invoke):
        parts["name"] = names.get(node.name, node.name)
    return type(node)(**parts)


class _View:
    """What the behaviour of a service takes for its instance: attributes of the instance around, under a prefix."""

    __slots__ = ("_instance", "_names", "extend__", "resource__")

    def __init__(self, instance: Any, names: Mapping[str, str]) -> None:
        for name, value in (
            ("extend__", _no_events),
            ("resource__", instance.resource__),
            ("_instance", instance),
            ("_names", names),
        ):
            object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._instance, self._names[name]) if name in self._names else ()

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._instance, self._names[name], value)


def _no_events(entries: object) -> None:
    """Output events of a block inside another one go nowhere."""


def _service(kind: model.FBType, path: str, space: dict[str, Any], block: model.FBType, line: int) -> dict[str, Any]:
    behaviour = clocked.BEHAVIOURS.get(kind.header.name)
    if behaviour is None:
        raise FunctionBlockError(
            f"{kind.header.name} inside a basic or simple block is a service: expected a basic or simple block, or "
            "a timer such as FB_TON",
            block.header.file,
            line,
        )
    under = reaction_name(path, "").removesuffix("on_")
    ports = (*kind.interface.inputs, *kind.interface.outputs)
    names = {python_name(variable.name): python_name(f"{path}.{variable.name}") for variable in ports}
    names |= {name: under + name for name in behaviour.state}

    def reaction(handler: EventHandler) -> EventHandler:
        return lambda instance: handler(_View(instance, names))

    for event, handler in behaviour.handlers.items():
        space[reaction_name(path, event)] = reaction(handler)
    return {under + name: value for name, value in behaviour.state.items()}
