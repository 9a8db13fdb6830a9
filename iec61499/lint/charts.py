"""Rules for execution control charts."""

from __future__ import annotations

from collections.abc import Iterator

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.lint.findings import Finding
from iec61499.st import ast
from iec61499.st.parser import parse_expression


def chart_findings(block: model.BasicFBType) -> Iterator[Finding]:
    """What states and transitions alone tell."""
    file = block.header.file
    leaving: dict[str, list[model.ECTransition]] = {state.name: [] for state in block.states}
    for transition in block.transitions:
        leaving[transition.source].append(transition)
    reached = _reached(block.states[0].name, leaving)
    for state in block.states:
        if state.name not in reached:
            yield Finding(file, state.line, 0, "unreachable-state", f"no transition leads to state {state.name}")
        elif not leaving[state.name] and len(block.states) > 1:
            yield Finding(file, state.line, 0, "stuck-state", f"no transition leaves state {state.name}")
        yield from _never(leaving[state.name], file)
    for transition in block.transitions:
        value = _constant(transition.guard)
        if value is False or (value and transition.event):  # [TRUE] alone is another way to write 1
            message = f"the condition of {_title(transition)} is always {str(value).upper()}"
            yield Finding(file, transition.line, 0, "condition-is-constant", message)
    yield from _endless(block, leaving)
    waited = {transition.event for transition in block.transitions if transition.source in reached}
    for event in block.interface.event_inputs:
        # one that only samples is useful, and an adapter has more than each of its users needs
        if event.name not in waited and not event.with_variables and "." not in event.name:
            message = f"no transition waits for event {event.name}"
            yield Finding(file, event.line, 0, "ignored-event", message)


def _title(transition: model.ECTransition) -> str:
    condition = transition.event + (f"[{transition.guard}]" if transition.guard else "") or "1"
    return f"{transition.source} -> {transition.destination} ({condition})"


def _reached(first: str, leaving: dict[str, list[model.ECTransition]]) -> set[str]:
    found, waiting = {first}, [first]
    while waiting:
        for transition in leaving[waiting.pop()]:
            if transition.destination not in found:
                found.add(transition.destination)
                waiting.append(transition.destination)
    return found


def _constant(guard: str) -> bool | None:
    """What a condition always is; None when that depends."""
    if not guard:
        return None
    try:
        tree = parse_expression(guard)
    except FunctionBlockError:
        return None
    return tree.value if isinstance(tree, ast.Literal) and isinstance(tree.value, bool) else None


def _never(transitions: list[model.ECTransition], file: str) -> Iterator[Finding]:
    """Transitions behind one with the same event, or none, that needs no more."""
    earlier: list[model.ECTransition] = []
    for transition in transitions:
        for other in earlier:
            needs_less = other.event in ("", transition.event)
            if needs_less and (not other.guard or other.guard == transition.guard):
                message = f"{_title(transition)} never fires: {_title(other)} in line {other.line} comes before it"
                yield Finding(file, transition.line, 0, "transition-never-fires", message)
                break
        earlier.append(transition)


def _endless(block: model.BasicFBType, leaving: dict[str, list[model.ECTransition]]) -> Iterator[Finding]:
    """Circles of states each of which is left at once, whatever the variables are."""
    onward: dict[str, model.ECTransition] = {}
    for name, transitions in leaving.items():
        first = next((t for t in transitions if not t.event), None)
        if first is not None and (not first.guard or _constant(first.guard) is True):
            onward[name] = first
    told: set[str] = set()
    for start in onward:
        path: list[str] = []
        state = start
        while state in onward and state not in path and state not in told:
            path.append(state)
            state = onward[state].destination
        if state in path:
            circle = path[path.index(state) :]
            message = f"{' -> '.join([*circle, state])} never comes to rest"
            yield Finding(block.header.file, onward[state].line, 0, "endless-chart", message)
        told |= {*path}
