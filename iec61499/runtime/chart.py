"""Writes the Python functions that execute an execution control chart, one for each event input.

A function is called with the block's instance after its inputs have been sampled. It does what IEC 61499-1, 5.2.2
says: the transitions of the current state are tried in order, with the event, then again and again without it
until none fires; entering a state runs its actions, each an algorithm followed by an output event. Chains of states
are written out one inside the other; only chains that come back to a state go through a loop.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from iec61499 import model

MAXIMUM_ENTRIES: Final = 24
"""Most states that one function writes out; the rest goes through the loop."""
CHAIN_LIMIT: Final = 10_000
"""Most transitions without an event that one event may cause."""


def handler_name(event: str, prefix: str = "") -> str:
    """The name of the function for an event input, which may be one of an adapter (`PLUG.REQ`)."""
    return f"{prefix}on_{event.replace('.', '__')}"


class ChartWriter:
    """Writes the functions of one block type.

    Args:
        states: the chart's states; the first is the initial one.
        transitions: the chart's transitions, in the order in which they are tried.
        guards: the guard of every transition that has one, as a Python expression over the instance `s`.
        actions: the actions of every state, by its name, as Python lines over the instance `s`.
        prefix: what stands before the names of the functions and of the state's attribute, for a block inside.
    """

    def __init__(
        self,
        states: Iterable[model.ECState],
        transitions: Iterable[model.ECTransition],
        guards: Mapping[model.ECTransition, str],
        actions: Mapping[str, list[str]],
        prefix: str = "",
    ) -> None:
        self._prefix = prefix
        self._state = f"s.{prefix}state__"
        self._numbers = {state.name: number for number, state in enumerate(states)}
        self._transitions = tuple(transitions)
        self._guards = guards
        self._actions = actions
        self._lines: list[str] = []
        self._entries = 0
        self._needs_loop = False

    def write(self, events: Iterable[str]) -> list[str]:
        """Source lines: `on_EVENT(s)` for each event, and the loop if one needs it."""
        for event in events:
            self._write_event(event)
        if self._needs_loop:
            self._write_loop()
        return self._lines

    def _write_event(self, event: str) -> None:
        self._lines.append(f"def {handler_name(event, self._prefix)}(s):")
        waiting = [state for state in self._numbers if any(t.event in ("", event) for t in self._leaving(state))]
        if not waiting:
            self._lines.append("    pass")
            return
        self._lines.append(f"    state = {self._state}")
        self._entries = 0
        for position, state in enumerate(waiting):
            keyword = "if" if position == 0 else "elif"
            self._lines.append(f"    {keyword} state == {self._numbers[state]}:")
            before = len(self._lines)
            self._leave(state, event, (), 2, origin=state)
            if len(self._lines) == before:
                self._lines.append("        pass")

    def _leaving(self, state: str) -> list[model.ECTransition]:
        return [t for t in self._transitions if t.source == state]

    def _leave(self, state: str, event: str, path: tuple[str, ...], depth: int, origin: str) -> None:
        """Tries the transitions of a state; `path` holds the states entered since the event, `state` last."""
        indent = "    " * depth
        stay = [] if not path or state == origin else [f"{self._state} = {self._numbers[state]}"]
        keyword = "if"
        for transition in self._leaving(state):
            if transition.event not in ("", event):
                continue
            guard = self._guards.get(transition)
            if guard is None and keyword == "if":
                self._enter(transition.destination, path, depth, origin)
                return
            self._lines.append(f"{indent}else:" if guard is None else f"{indent}{keyword} {guard}:")
            before = len(self._lines)
            self._enter(transition.destination, path, depth + 1, origin)
            if len(self._lines) == before:
                self._lines.append(f"{indent}    pass")
            if guard is None:
                return
            keyword = "elif"
        if stay:
            if keyword == "elif":
                self._lines.append(f"{indent}else:")
                indent += "    "
            self._lines += [indent + line for line in stay]

    def _enter(self, state: str, path: tuple[str, ...], depth: int, origin: str) -> None:
        indent = "    " * depth
        self._entries += 1
        if state in path or self._entries > MAXIMUM_ENTRIES:
            self._needs_loop = True
            self._lines.append(f"{indent}{self._prefix}settle(s, {self._numbers[state]})")
            return
        self._lines += [indent + line for line in self._actions.get(state, ())]
        self._leave(state, "", (*path, state), depth, origin)

    def _write_loop(self) -> None:
        """`settle(s, state)` enters a state and follows event-less transitions, one at a time."""
        self._lines += [f"def {self._prefix}settle(s, state):", f"    for _ in range({CHAIN_LIMIT}):"]
        for state, number in self._numbers.items():
            self._lines.append(f"        if state == {number}:")
            self._lines += ["            " + line for line in self._actions.get(state, ())]
            for transition in self._leaving(state):
                if not transition.event:
                    guard = self._guards.get(transition, "True")
                    target = self._numbers[transition.destination]
                    self._lines += [f"            if {guard}:", f"                state = {target}"]
                    self._lines.append("                continue")
            self._lines += ["            break"]
        self._lines += ["    else:", "        endless_chain(s)", f"    {self._state} = state"]
