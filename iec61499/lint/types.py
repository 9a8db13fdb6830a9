"""Rules for block types: their variables, events and algorithms."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.lint.charts import chart_findings
from iec61499.lint.findings import Finding
from iec61499.lint.text import Place, checked_findings, parsed_findings, placed
from iec61499.lint.usage import Usage
from iec61499.runtime.checker import BlockChecker
from iec61499.runtime.linking.generic_ports import unconnected
from iec61499.st import ast
from iec61499.st.parser import parse_algorithm, parse_expression
from iec61499.types import ELEMENTARY

_KEYWORDS: Final = frozenset(
    {"ALGORITHM", "AND", "ARRAY", "BY", "CASE", "CONSTANT", "CONTINUE", "DO", "ELSE", "ELSIF", "END_ALGORITHM"}
    | {"END_CASE", "END_FOR", "END_IF", "END_REPEAT", "END_STRUCT", "END_TYPE", "END_VAR", "END_WHILE", "EXIT"}
    | {"FALSE", "FOR", "FUNCTION", "FUNCTION_BLOCK", "IF", "MOD", "NOT", "OF", "OR", "PROGRAM", "REPEAT", "RETURN"}
    | {"STRUCT", "THEN", "TO", "TRUE", "TYPE", "UNTIL", "VAR", "VAR_IN_OUT", "VAR_INPUT", "VAR_OUTPUT", "VAR_TEMP"}
    | {"WHILE", "XOR"}
)
_RESERVED: Final = (_KEYWORDS | {*ELEMENTARY}) - {"DT"}
"""Names that are taken; DT, short for DATE_AND_TIME, is an input of the standard's own E_CYCLE and E_DELAY."""


def type_findings(block: model.LibraryElement) -> Iterator[Finding]:
    """What is hardly meant in a type that can be read."""
    yield from _interface_findings(block)
    if isinstance(block, model.BasicFBType):
        yield from chart_findings(block)
    if isinstance(block, model.SimpleFBType):
        yield from _simple_findings(block)
    if isinstance(block, model.BasicFBType | model.SimpleFBType):
        yield from _algorithmic_findings(block)


def _interface_findings(block: model.LibraryElement) -> Iterator[Finding]:
    file, interface = block.header.file, block.interface
    internals = getattr(block, "internals", ())
    events = (*interface.event_inputs, *interface.event_outputs)
    variables = {v.name: v for v in (*interface.inputs, *interface.outputs, *internals)}
    for named in (*events, *variables.values()):
        if named.name.upper() in _RESERVED:
            message = f"{named.name} is a keyword of IEC 61131-3: expected another name"
            yield Finding(file, named.line, 0, "reserved-name", message)
    if isinstance(block, model.SubApplicationType):
        return  # its ports only pass connections on
    sampled = {name for event in interface.event_inputs for name in event.with_variables}
    published = {name for event in interface.event_outputs for name in event.with_variables}
    own = {port.name for port in interface.adapters}
    for variable in interface.inputs if interface.event_inputs else ():
        if variable.name not in sampled | {*interface.in_outs} and variable.name.partition(".")[0] not in own:
            message = f"input {variable.name} is in no WITH: it never gets what is connected to it"
            yield Finding(file, variable.line, 0, "not-sampled", message)
    for variable in interface.outputs if interface.event_outputs else ():
        if variable.name not in published | {*interface.in_outs} and variable.name.partition(".")[0] not in own:
            message = f"output {variable.name} is in no WITH: other blocks never see what it gets"
            yield Finding(file, variable.line, 0, "not-published", message)


def _simple_findings(block: model.SimpleFBType) -> Iterator[Finding]:
    states = {state.name for state in block.states}
    for event in block.interface.event_inputs:
        if event.name not in states and states and not event.with_variables and "." not in event.name:
            message = f"no state is called as event {event.name}: it does nothing"
            yield Finding(block.header.file, event.line, 0, "ignored-event", message)


def _algorithmic_findings(block: model.BasicFBType | model.SimpleFBType) -> Iterator[Finding]:
    file = block.header.file
    actions = [action for state in block.states for action in state.actions]
    executed, issued = {a.algorithm for a in actions}, {a.output for a in actions}
    for algorithm in block.algorithms:
        if algorithm.name not in executed:
            message = f"no state executes algorithm {algorithm.name}"
            yield Finding(file, algorithm.line, 0, "unused-algorithm", message)
    for event in block.interface.event_outputs:
        if event.name not in issued and "." not in event.name:  # an adapter has more than each of its users needs
            message = f"no state issues event {event.name}"
            yield Finding(file, event.line, 0, "event-never-issued", message)
    usage, trees = Usage(), []
    try:
        for algorithm in block.algorithms:
            trees.append((algorithm, parse_algorithm(algorithm.source.text, file, 1, 1)))
            for statement in trees[-1][1].body:
                usage.add(statement)
            for declaration in trees[-1][1].declarations:
                _add_declaration(declaration, usage)
        for transition in block.transitions if isinstance(block, model.BasicFBType) else ():
            if transition.guard:
                usage.add(parse_expression(transition.guard, file, 1, 1))
    except FunctionBlockError:
        return  # what cannot be parsed is a finding of its own, and may use any variable
    for algorithm, tree in trees:
        yield from parsed_findings(tree, algorithm.name, placed(algorithm, file))
    yield from _typed_findings(block)
    yield from _variable_findings(block, usage)


def _add_declaration(declaration: ast.Declaration, usage: Usage) -> None:
    for part in [*declaration.type_name.bounds, *([declaration.initial] if declaration.initial is not None else [])]:
        usage.add(part)


def _typed_findings(block: model.BasicFBType | model.SimpleFBType) -> Iterator[Finding]:
    try:
        checker = BlockChecker(unconnected(block))
        checked = [(algorithm, checker.algorithm(algorithm)) for algorithm in block.algorithms]
    except FunctionBlockError:
        return
    for algorithm, code in checked:
        yield from checked_findings(code.body, algorithm.name, _in_file(algorithm, block.header.file))


def _in_file(algorithm: model.Algorithm, file: str) -> Place:
    """Where positions of a checked algorithm are, which counts lines as the file does, if it can."""
    source = algorithm.source
    return lambda at: (file, at.line, at.column) if source.exact else (file, source.line, 0)


def _variable_findings(block: model.BasicFBType | model.SimpleFBType, usage: Usage) -> Iterator[Finding]:
    file, interface = block.header.file, block.interface
    invoked = {inner.name.upper() for inner in block.blocks}
    for variable in block.internals:
        name = variable.name.upper()
        if name.partition(".")[0] in invoked and "." in name:
            continue
        if variable.constant and not variable.initial:
            message = f"constant {variable.name} has no initial value"
            yield Finding(file, variable.line, 0, "constant-without-value", message)
        if name not in usage.reads | usage.writes:
            yield Finding(file, variable.line, 0, "unused-variable", f"variable {variable.name} is never used")
        elif name not in usage.writes and not variable.initial and not variable.constant:
            message = f"variable {variable.name} is read, but never written, and has no initial value"
            yield Finding(file, variable.line, 0, "never-written", message)
        elif name not in usage.reads:
            yield Finding(
                file, variable.line, 0, "never-read", f"variable {variable.name} is written, but never read"
            )
    for variable in interface.inputs:
        if variable.name.upper() not in usage.reads | usage.writes and "." not in variable.name:
            yield Finding(file, variable.line, 0, "unused-input", f"input {variable.name} is never read")
    for variable in interface.outputs:
        name = variable.name.upper()
        if name not in usage.writes and not variable.initial and "." not in name and name not in usage.reads:
            yield Finding(file, variable.line, 0, "output-never-written", f"output {variable.name} is never written")
