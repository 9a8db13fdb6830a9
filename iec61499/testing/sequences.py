"""Service sequences of block types (IEC 61499-2, `<ServiceSequence>`) as tests.

Every transaction is an input primitive, an event with values for inputs, and the output primitives that follow: the
events that must come, in this order, with the values that are given for outputs. Outputs that do not come at once
may come later, when timed blocks issue their events. A sign behind an event is the value of QI or QO.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.files.xml import XmlElement, read_xml
from iec61499.literals import format_literal
from iec61499.runtime.compile import has_no_service
from iec61499.testing import session
from iec61499.testing.bench import Bench, bench_of
from iec61499.testing.runtimes import Inapplicable, Issued

_QUALIFIERS: Final = {"+": "TRUE", "-": "FALSE"}


class Failed(FunctionBlockError):
    """The block has not done what a sequence says."""


@dataclass(frozen=True)
class Primitive:
    """An event of a sequence, with the literals of its parameters by name ("" where only the name is given)."""

    event: str
    interface: str
    parameters: tuple[tuple[str, str], ...]
    line: int

    def __str__(self) -> str:
        given = "; ".join(f"{name}:={value}" for name, value in self.parameters if value)
        return f"{self.event}({given})" if given else self.event


@dataclass(frozen=True)
class Transaction:
    """Inputs, and the outputs that follow from them."""

    inputs: tuple[Primitive, ...]
    outputs: tuple[Primitive, ...]


@dataclass(frozen=True)
class Sequence:
    """A service sequence.

    Attributes:
        name: its name.
        transactions: what happens, in order.
        environment: the interface beyond the block, to which its primitives do not belong.
        state: the state that the chart must be in at the beginning; "" for any.
        file, line: where it is.
    """

    name: str
    transactions: tuple[Transaction, ...]
    environment: str
    state: str
    file: str
    line: int


def read_sequences(file: Path) -> tuple[Sequence, ...]:
    """The service sequences of a type. Raises FunctionBlockError for a file that is no XML."""
    root = read_xml(file)
    service = root.child("Service")
    return tuple(_read(element, service) for element in service.children("ServiceSequence")) if service else ()


def _read(element: XmlElement, service: XmlElement) -> Sequence:
    left, right = service.get("LeftInterface"), service.get("RightInterface")
    attributes = {each.get("Name"): each.get("Value") for each in element.children("Attribute")}
    state = element.get("StartState") or attributes.get("StartState", "")
    made = tuple(_transaction(each) for each in element.children("ServiceTransaction"))
    return Sequence(element.get("Name"), made, right if right != left else "", state, element.file, element.line)


def _transaction(element: XmlElement) -> Transaction:
    inputs = tuple(_primitive(each) for each in element.children("InputPrimitive"))
    return Transaction(inputs, tuple(_primitive(each) for each in element.children("OutputPrimitive")))


def _primitive(element: XmlElement) -> Primitive:
    event, qualifier = element.get("Event").strip(), ""
    if event[-1:] in _QUALIFIERS:
        event, qualifier = event[:-1], _QUALIFIERS[event[-1]]
    given = list(_parameters(element.get("Parameters")))
    if qualifier:
        given.append(("QI" if element.tag == "InputPrimitive" else "QO", qualifier))
    return Primitive(event, element.get("Interface"), tuple(given), element.line)


def _parameters(text: str) -> Iterator[tuple[str, str]]:
    """Names and literals of `IN:=1; NAME:='a;b'`, between commas, semicolons or lines outside of quotes and lists."""
    part, quote, depth = "", "", 0
    for character in f"{text};":
        if quote:
            quote = "" if character == quote and part[-1:] != "$" else quote
        elif character in "'\"":
            quote = character
        elif character in "[(":
            depth += 1
        elif character in "])":
            depth -= 1
        elif character in ";,\n" and not depth:
            name, _, value = part.partition(":=")
            if name.strip():
                yield name.strip(), value.strip()
            part = ""
            continue
        part += character


def run_sequence(sequence: Sequence, kind: model.LibraryElement) -> None:
    """Lets a block go through a sequence.

    Raises:
        Inapplicable: it names what the block does not have, or the block is a service that the runtime lacks.
        Failed: the block has done something else.
        FunctionBlockError: the block is wrong, or has failed.
    """
    _check(sequence, kind)
    if not session.current.is_device and isinstance(kind, model.ServiceInterfaceFBType) and has_no_service(kind):
        message = f"{sequence.name}: {kind.header.name} is a service that this runtime does not have"
        raise Inapplicable(message, sequence.file, sequence.line)
    bench = bench_of(kind, Path(kind.header.file).parent, {})
    try:
        if sequence.state and bench.state != sequence.state:
            raise Inapplicable(
                f"{sequence.name}: begins in the state {sequence.state}, a test in {bench.state}",
                sequence.file,
                sequence.line,
            )
        for transaction in sequence.transactions:
            _go_through(transaction, bench, sequence)
    finally:
        session.current.close()


def _check(sequence: Sequence, kind: model.LibraryElement) -> None:
    """Raises Inapplicable for a primitive that names no event or variable of the block."""
    interface = kind.interface
    primitives = [
        (primitive, outgoing)
        for transaction in sequence.transactions
        for outgoing, group in enumerate((transaction.inputs, transaction.outputs))
        for primitive in group
    ]
    if not primitives:
        raise Inapplicable(f"{sequence.name}: has no primitives", sequence.file, sequence.line)
    for primitive, outgoing in primitives:
        events = [event.name for event in (interface.event_outputs if outgoing else interface.event_inputs)]
        variables = [variable.name for variable in (interface.outputs if outgoing else interface.inputs)]
        problem = ""
        if sequence.environment and primitive.interface == sequence.environment:
            problem = f"{primitive.event} is an event of {primitive.interface}, which only a platform has"
        elif primitive.event not in events:
            problem = f"the block has no event {'output' if outgoing else 'input'} {primitive.event}"
        else:
            missing = [name for name, _ in primitive.parameters if name not in variables]
            if missing:
                problem = f"the block has no {'output' if outgoing else 'input'} {missing[0]}"
        if problem:
            raise Inapplicable(f"{sequence.name}: {problem}", sequence.file, primitive.line)


def _go_through(transaction: Transaction, bench: Bench, sequence: Sequence) -> None:
    interface = bench.kind.interface
    types = {variable.name: variable.type for variable in (*interface.inputs, *interface.outputs)}
    came: list[Issued] = []
    for primitive in transaction.inputs:
        given = [(name, literal) for name, literal in primitive.parameters if literal]
        inputs = {name: _value(literal, types[name], sequence, primitive) for name, literal in given}
        bench.fire(primitive.event, **inputs)
        came += bench.issued
    if len(came) < len(transaction.outputs):
        bench.wait(len(transaction.outputs) - len(came))
        came += bench.issued
    cause = ", ".join(map(str, transaction.inputs)) or "time"
    line = transaction.inputs[0].line if transaction.inputs else sequence.line
    outputs = transaction.outputs
    if session.current.is_device:  # which does not tell the order
        order = [event.name for event in interface.event_outputs]
        outputs = tuple(sorted(outputs, key=lambda primitive: order.index(primitive.event)))
        came.sort(key=lambda issued: order.index(issued[0]))
    expected = [primitive.event for primitive in outputs]
    got = [name for name, _ in came]
    if got != expected:
        wanted, found = (", ".join(names) or "no event" for names in (expected, got))
        raise Failed(f"{sequence.name}: after {cause} expected {wanted}, got {found}", sequence.file, line)
    for primitive, (_, values) in zip(outputs, came, strict=True):
        for name, literal in primitive.parameters:
            kind = types[name]
            if not literal or isinstance(kind, model.GenericType):
                continue
            value = values[name] if name in values else bench[name]
            if value != _value(literal, kind, sequence, primitive):
                raise Failed(
                    f"{sequence.name}: after {cause} expected {primitive.event} with {name}:={literal}, "
                    f"got {name}:={format_literal(value, kind)}",
                    sequence.file,
                    primitive.line,
                )


def _value(literal: str, kind: model.VariableType, sequence: Sequence, primitive: Primitive) -> Any:
    if isinstance(kind, model.GenericType):
        return literal
    try:
        return model.literal(literal, kind)
    except FunctionBlockError as error:
        raise FunctionBlockError(f"{sequence.name}: {error.message}", sequence.file, primitive.line) from None
