"""Reads block types (.fbt) and subapplication types (.sub) as 4diac IDE writes them (IEC 61499-2 XML).

What the runtime cannot execute is refused here, by name and line: adapters, VAR_IN_OUT, algorithms in other
languages, data types that are not elementary. What only concerns editors (attributes, services, compiler
information, groups, comments in diagrams) is passed over.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, Protocol, TypeVar

from dtwin.errors import FunctionBlockError, choices
from dtwin.iec61499 import model
from dtwin.iec61499.files.networks import PASSED_OVER, read_network
from dtwin.iec61499.files.xml import Element, read_xml
from dtwin.iec61499.types import ArrayType, elementary

_IDENTIFIER: Final = re.compile(r"(?!\w*__)[A-Za-z_][A-Za-z0-9_]*", re.ASCII)
_TYPE_PARTS: Final = (
    *("InterfaceList", "SubAppInterfaceList", "BasicFB", "SimpleFB", "FBNetwork", "SubAppNetwork"),
    *PASSED_OVER,
)


_ALGORITHMIC_PARTS: Final = ("InternalVars", "InternalConstVars", "Algorithm", "Method", "Attribute")
_PORT_GROUPS: Final = ("EventInputs", "EventOutputs", "InputVars", "OutputVars")
_UNSUPPORTED_GROUPS: Final = {"Sockets": "adapter", "Plugs": "adapter", "InOutVars": "VAR_IN_OUT variable"}


class _Named(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def line(self) -> int: ...


_N = TypeVar("_N", bound=_Named)


def read_type(path: Path) -> model.LibraryElement:
    """Reads one library element.

    Raises:
        FunctionBlockError: the file is unreadable or wrong, or uses something unsupported; names file and line.
    """
    return type_from_xml(read_xml(path))


def type_from_xml(root: Element) -> model.LibraryElement:
    """As `read_type`, from the root element."""
    if root.tag not in ("FBType", "SubAppType"):
        raise root.error(f"<{root.tag}> is not a block type: expected <FBType> or <SubAppType>")
    root.expect_children(_TYPE_PARTS)
    header = read_header(root)
    interface = read_interface(root)
    if root.tag == "SubAppType":
        body = root.child("SubAppNetwork") or root.child("FBNetwork")
        return model.SubApplicationType(header, interface, read_network(body, root.file, read_interface))
    basic, simple, network = root.child("BasicFB"), root.child("SimpleFB"), root.child("FBNetwork")
    if basic is not None:
        return _read_basic(basic, header, interface)
    if simple is not None:
        return _read_simple(simple, header, interface)
    if network is not None:
        return model.CompositeFBType(header, interface, read_network(network, root.file, read_interface))
    return model.ServiceInterfaceFBType(header, interface)


def read_header(root: Element) -> model.TypeHeader:
    """Name, comment, identification, versions and package of a library element."""
    identification, compiler = root.child("Identification"), root.child("CompilerInfo")
    versions = tuple(
        model.Version(*(entry.get(name) for name in ("Version", "Author", "Date", "Organization", "Remarks")))
        for entry in root.children("VersionInfo")
    )
    return model.TypeHeader(
        _identifier(root),
        root.file,
        root.line,
        root.get("Comment"),
        identification.get("Standard") if identification is not None else "",
        identification.get("Description") if identification is not None else "",
        versions,
        compiler.get("packageName") if compiler is not None else "",
    )


def read_interface(owner: Element) -> model.Interface:
    """The ports declared by the interface list of a type or subapplication; none without such a list."""
    interface = owner.child("InterfaceList") or owner.child("SubAppInterfaceList")
    if interface is None:
        return model.Interface()
    groups: dict[str, Element] = {}
    interface.expect_children([*_PORT_GROUPS, *_UNSUPPORTED_GROUPS, *(f"SubApp{group}" for group in _PORT_GROUPS)])
    for group in interface.children():
        first = next(group.children(), None)
        if group.tag in _UNSUPPORTED_GROUPS and first is not None:
            what = _UNSUPPORTED_GROUPS[group.tag]
            raise first.error(f"{what} {first.get('Name')} is not supported: expected events and data only")
        groups[group.tag.removeprefix("SubApp")] = group
    inputs = read_variables(groups.get("InputVars"))
    outputs = read_variables(groups.get("OutputVars"))
    result = model.Interface(
        _read_events(groups.get("EventInputs"), inputs, "input"),
        _read_events(groups.get("EventOutputs"), outputs, "output"),
        inputs,
        outputs,
    )
    ports: list[_Named] = [*result.event_inputs, *result.event_outputs, *result.inputs, *result.outputs]
    check_unique(ports, "port", owner.file)
    return result


def _read_events(
    group: Element | None, variables: Sequence[model.Variable], direction: str
) -> tuple[model.Event, ...]:
    names = [variable.name for variable in variables]
    events = []
    if group is None:
        return ()
    group.expect_children(("Event", "SubAppEvent"))
    for element in group.children():
        element.expect_children(("With", "Attribute"))
        if element.get("Type", "Event") not in ("Event", "EInit", ""):
            raise element.error(f"event type {element.get('Type')} is not supported: expected Event")
        with_variables = tuple(w.require("Var") for w in element.children("With"))
        for with_element, name in zip(element.children("With"), with_variables, strict=True):
            if name not in names:
                valid = f"expected {choices(names)}" if names else f"the type has no {direction} variable"
                raise with_element.error(
                    f"unknown {direction} variable {name} in WITH of {element.get('Name')}: {valid}"
                )
        events.append(model.Event(_identifier(element), with_variables, element.get("Comment"), element.line))
    return tuple(events)


def read_variables(group: Element | None) -> tuple[model.Variable, ...]:
    """The variable declarations of a group."""
    variables = []
    if group is None:
        return ()
    for block in group.children("FB"):
        raise block.error(f"block {block.get('Name')} inside a basic block is not supported: expected variables only")
    group.expect_children(("VarDeclaration",))
    for element in group.children():
        element.expect_children(("Attribute",))
        name = _identifier(element)
        variable = model.Variable(
            name, _variable_type(element), element.get("InitialValue"), element.get("Comment"), element.line
        )
        model.initial_value(variable, element.file)
        variables.append(variable)
    return tuple(variables)


def _variable_type(element: Element) -> model.VariableType:
    name = element.require("Type")
    if name.upper().startswith("ANY"):
        if element.get("ArraySize"):
            raise element.error(f"array of {name} is not supported: expected an elementary type")
        if name.upper() not in model.GENERIC_TYPES:
            raise element.error(f"unknown generic type {name}: expected {choices(model.GENERIC_TYPES)}")
        return model.GenericType(name.upper())
    try:
        data_type = elementary(name)
        return _array_type(element, data_type) if element.get("ArraySize") else data_type
    except FunctionBlockError as error:
        raise element.error(f"variable {element.get('Name')}: {error.message}") from None


def _array_type(element: Element, data_type: model.DataType) -> ArrayType:
    """`4` is 0..3; `1..3`; several dimensions are separated by commas, the first is the outermost."""
    for dimension in reversed(element.get("ArraySize").split(",")):
        bounds = re.fullmatch(r"\s*(-?\d{1,9})\s*(?:\.\.\s*(-?\d{1,9})\s*)?", dimension)
        if bounds is None:
            raise element.error(f"array size {element.get('ArraySize')!r}: expected a number or bounds such as 1..3")
        lower, upper = (0, int(bounds[1]) - 1) if bounds[2] is None else (int(bounds[1]), int(bounds[2]))
        data_type = ArrayType(data_type, lower, upper)
        if data_type.length > model.MAXIMUM_ARRAY_LENGTH:
            raise element.error(
                f"array of {data_type.length} elements: expected at most {model.MAXIMUM_ARRAY_LENGTH}"
            )
    assert isinstance(data_type, ArrayType)
    return data_type


def _read_basic(body: Element, header: model.TypeHeader, interface: model.Interface) -> model.BasicFBType:
    body.expect_children((*_ALGORITHMIC_PARTS, "ECC"))
    chart = body.child("ECC")
    if chart is None:
        raise body.error(f"basic block {header.name} has no <ECC>")
    internals = _read_internals(body, interface)
    algorithms = _read_algorithms(body)
    states = _read_states(chart, interface, algorithms)
    if not states:
        raise chart.error(f"the ECC of {header.name} has no state")
    chart.expect_children(("ECState", "ECTransition", "Attribute"))
    transitions = tuple(_read_transition(t, interface, states) for t in chart.children("ECTransition"))
    return model.BasicFBType(header, interface, internals, states, transitions, algorithms)


def _read_simple(body: Element, header: model.TypeHeader, interface: model.Interface) -> model.SimpleFBType:
    body.expect_children((*_ALGORITHMIC_PARTS, "ECState"))
    internals = _read_internals(body, interface)
    algorithms = _read_algorithms(body)
    states = _read_states(body, interface, algorithms)
    inputs = [event.name for event in interface.event_inputs]
    for state in states:
        if state.name not in inputs:
            raise FunctionBlockError(
                f"unknown event input {state.name}: expected {_expected(inputs)}", header.file, state.line
            )
    if not states and algorithms and inputs:
        output = interface.event_outputs[0].name if interface.event_outputs else ""
        action = model.Action(algorithms[0].name, output, algorithms[0].line)
        states = (model.State(inputs[0], (action,), line=body.line),)
    return model.SimpleFBType(header, interface, internals, states, algorithms)


def _read_internals(body: Element, interface: model.Interface) -> tuple[model.Variable, ...]:
    internals = tuple(
        variable for group in ("InternalVars", "InternalConstVars") for variable in read_variables(body.child(group))
    )
    check_unique([*interface.inputs, *interface.outputs, *internals], "variable", body.file)
    return internals


def _read_algorithms(body: Element) -> tuple[model.Algorithm, ...]:
    algorithms = []
    for method in body.children("Method"):
        raise method.error(f"method {method.get('Name')} is not supported: expected algorithms")
    for element in body.children("Algorithm"):
        algorithms.append(_read_algorithm(element))
    check_unique(algorithms, "algorithm", body.file)
    return tuple(algorithms)


def _read_algorithm(element: Element) -> model.Algorithm:
    name = _identifier(element)
    source = element.child("ST")
    if source is None:
        other = next(element.children(), None)
        language = other.get("Language", other.tag) if other is not None else "no language"
        raise element.error(f"algorithm {name} in {language} is not supported: expected Structured Text (<ST>)")
    if source.get("Text"):
        text = model.Source(source.get("Text"), source.line)
    else:
        text = model.Source(source.text, source.line, exact=True)
    return model.Algorithm(name, text, element.get("Comment"), element.line)


def _read_states(
    chart: Element, interface: model.Interface, algorithms: Sequence[model.Algorithm]
) -> tuple[model.State, ...]:
    algorithm_names = [algorithm.name for algorithm in algorithms]
    outputs = [event.name for event in interface.event_outputs]
    states = []
    for element in chart.children("ECState"):
        element.expect_children(("ECAction", "Attribute"))
        actions = []
        for action in element.children("ECAction"):
            algorithm, output = action.get("Algorithm"), action.get("Output")
            if algorithm and algorithm not in algorithm_names:
                raise action.error(f"unknown algorithm {algorithm}: expected {_expected(algorithm_names)}")
            if output and output not in outputs:
                raise action.error(f"unknown event output {output}: expected {_expected(outputs)}")
            actions.append(model.Action(algorithm, output, action.line))
        states.append(
            model.State(
                _identifier(element),
                tuple(actions),
                element.number("x"),
                element.number("y"),
                element.get("Comment"),
                element.line,
            )
        )
    check_unique(states, "state", chart.file)
    return tuple(states)


def _read_transition(element: Element, interface: model.Interface, states: Sequence[model.State]) -> model.Transition:
    names = [state.name for state in states]
    for end in ("Source", "Destination"):
        if element.require(end) not in names:
            raise element.error(f"transition from or to unknown state {element.get(end)}: expected {choices(names)}")
    event, guard = split_condition(element.require("Condition"), [e.name for e in interface.event_inputs])
    return model.Transition(
        element.get("Source"),
        element.get("Destination"),
        event,
        guard,
        element.number("x"),
        element.number("y"),
        element.get("Comment"),
        element.line,
    )


def split_condition(condition: str, events: Iterable[str]) -> tuple[str, str]:
    """Event and guard of a transition condition: `EV`, `EV[guard]`, `[guard]`, `1`, and the old `EV & guard`."""
    text = condition.strip()
    match = _IDENTIFIER.match(text)
    event = match[0] if match and match[0] in set(events) else ""
    rest = text[len(event) :].strip()
    old = re.match(r"&|AND\b", rest, re.IGNORECASE) if event else None
    if old is not None:
        rest = rest[old.end() :].strip()
    elif rest.startswith("[") and rest.endswith("]"):
        rest = rest[1:-1].strip()
    return event, "" if rest == "1" else rest


def check_unique(items: Sequence[_N], what: str, file: str) -> None:
    """Raises FunctionBlockError at the second of two items of one name."""
    first: dict[str, _N] = {}
    for item in items:
        other = first.setdefault(item.name.upper(), item)
        if other is not item:
            raise FunctionBlockError(f"{what} {item.name} is already declared in line {other.line}", file, item.line)


def _identifier(element: Element) -> str:
    name = element.require("Name")
    if not _IDENTIFIER.fullmatch(name):
        raise element.error(f"{name!r} is not an identifier: expected letters, digits and single _")
    return name


def _expected(names: Sequence[str]) -> str:
    return choices(names) if names else "none, as there is none"
