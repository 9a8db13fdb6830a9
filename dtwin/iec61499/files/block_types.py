"""Reads block types (.fbt) and subapplication types (.sub) as 4diac IDE writes them (IEC 61499-2 XML).

What the runtime cannot execute is refused here, by name and line: adapters, VAR_IN_OUT, algorithms in other
languages, data types that are not elementary. What only concerns editors (attributes, services, compiler
information, groups, comments in diagrams) is passed over.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from dtwin.errors import FunctionBlockError, choices
from dtwin.iec61499 import model
from dtwin.iec61499.files.header import IDENTIFIER, PASSED_OVER, check_unique, read_header, read_name
from dtwin.iec61499.files.interface import read_interface, read_variables
from dtwin.iec61499.files.networks import read_network
from dtwin.iec61499.files.xml import XmlElement, read_xml

_TYPE_PARTS: Final = (
    *("InterfaceList", "SubAppInterfaceList", "BasicFB", "SimpleFB", "FBNetwork", "SubAppNetwork"),
    *PASSED_OVER,
)


_ALGORITHMIC_PARTS: Final = ("InternalVars", "InternalConstVars", "Algorithm", "Method", "Attribute")


def read_type(path: Path) -> model.LibraryElement:
    """Reads one library element.

    Raises:
        FunctionBlockError: the file is unreadable or wrong, or uses something unsupported; names file and line.
    """
    return type_from_xml(read_xml(path))


def type_from_xml(root: XmlElement) -> model.LibraryElement:
    """Reads one library element, given its root element. Raises as `read_type` does."""
    if root.tag not in ("FBType", "SubAppType"):
        raise root.error(f"<{root.tag}> is not a block type: expected <FBType> or <SubAppType>")
    root.expect_children(_TYPE_PARTS)
    header = read_header(root)
    interface = read_interface(root)
    if root.tag == "SubAppType":
        body = root.child("SubAppNetwork") or root.child("FBNetwork")
        return model.SubApplicationType(header, interface, read_network(body, root.file))
    basic, simple, network = root.child("BasicFB"), root.child("SimpleFB"), root.child("FBNetwork")
    if basic is not None:
        return _read_basic(basic, header, interface)
    if simple is not None:
        return _read_simple(simple, header, interface)
    if network is not None:
        return model.CompositeFBType(header, interface, read_network(network, root.file))
    return model.ServiceInterfaceFBType(header, interface)


def _read_basic(body: XmlElement, header: model.TypeHeader, interface: model.Interface) -> model.BasicFBType:
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


def _read_simple(body: XmlElement, header: model.TypeHeader, interface: model.Interface) -> model.SimpleFBType:
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
        action = model.ECAction(algorithms[0].name, output, algorithms[0].line)
        states = (model.ECState(inputs[0], (action,), line=body.line),)
    return model.SimpleFBType(header, interface, internals, states, algorithms)


def _read_internals(body: XmlElement, interface: model.Interface) -> tuple[model.Variable, ...]:
    internals = tuple(
        variable for group in ("InternalVars", "InternalConstVars") for variable in read_variables(body.child(group))
    )
    check_unique([*interface.inputs, *interface.outputs, *internals], "variable", body.file)
    return internals


def _read_algorithms(body: XmlElement) -> tuple[model.Algorithm, ...]:
    algorithms = []
    for method in body.children("Method"):
        raise method.error(f"method {method.get('Name')} is not supported: expected algorithms")
    for element in body.children("Algorithm"):
        algorithms.append(_read_algorithm(element))
    check_unique(algorithms, "algorithm", body.file)
    return tuple(algorithms)


def _read_algorithm(element: XmlElement) -> model.Algorithm:
    name = read_name(element)
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
    chart: XmlElement, interface: model.Interface, algorithms: Sequence[model.Algorithm]
) -> tuple[model.ECState, ...]:
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
            actions.append(model.ECAction(algorithm, output, action.line))
        states.append(
            model.ECState(
                read_name(element),
                tuple(actions),
                element.number("x"),
                element.number("y"),
                element.get("Comment"),
                element.line,
            )
        )
    check_unique(states, "state", chart.file)
    return tuple(states)


def _read_transition(
    element: XmlElement, interface: model.Interface, states: Sequence[model.ECState]
) -> model.ECTransition:
    names = [state.name for state in states]
    for end in ("Source", "Destination"):
        if element.require(end) not in names:
            raise element.error(f"transition from or to unknown state {element.get(end)}: expected {choices(names)}")
    event, guard = split_condition(element.require("Condition"), [e.name for e in interface.event_inputs])
    return model.ECTransition(
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
    match = IDENTIFIER.match(text)
    event = match[0] if match and match[0] in set(events) else ""
    rest = text[len(event) :].strip()
    old = re.match(r"&|AND\b", rest, re.IGNORECASE) if event else None
    if old is not None:
        rest = rest[old.end() :].strip()
    elif rest.startswith("[") and rest.endswith("]"):
        rest = rest[1:-1].strip()
    return event, "" if rest == "1" else rest


def _expected(names: Sequence[str]) -> str:
    return choices(names) if names else "none, as there is none"
