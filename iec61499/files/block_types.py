"""Reads types of blocks (.fbt, .fct), subapplications (.sub) and adapters (.adp) as 4diac IDE writes them.

What the runtime cannot execute is refused here, by name and line: methods, algorithms in other languages. What only
concerns editors (attributes, services, compiler information, groups, comments in diagrams) is passed over.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from iec61499 import model
from iec61499.errors import FunctionBlockError, choices
from iec61499.files.functions import ForeignLanguageError, read_function
from iec61499.files.header import PASSED_OVER, Named, check_unique, read_header, read_name
from iec61499.files.inner_blocks import read_inner_blocks
from iec61499.files.interface import read_interface, read_variables
from iec61499.files.names import ALONE, Names, absent_constants, used_constants, with_imports
from iec61499.files.networks import read_network
from iec61499.files.xml import XmlElement, read_xml

_TYPE_PARTS: Final = (
    *("InterfaceList", "SubAppInterfaceList", "BasicFB", "SimpleFB", "FBNetwork", "SubAppNetwork", "FunctionBody"),
    *PASSED_OVER,
)


_EVENT: Final = re.compile(r"([A-Za-z_]\w*)(?:\.[A-Za-z_]\w*)?", re.ASCII)
"""An event input, or one of an adapter."""
_ALGORITHMIC_PARTS: Final = ("InternalVars", "InternalConstVars", "Algorithm", "Method", "Attribute")


def read_type(path: Path, names: Names = ALONE) -> model.LibraryElement:
    """Reads one library element.

    Raises:
        FunctionBlockError: the file is unreadable or wrong, or uses something unsupported; names file and line.
    """
    return type_from_xml(read_xml(path), names)


def type_from_xml(root: XmlElement, names: Names = ALONE) -> model.LibraryElement:
    """Reads one library element, given its root element. Raises as `read_type` does."""
    if root.tag not in ("FBType", "SubAppType", "Function"):
        raise root.error(f"<{root.tag}> is not a block type: expected <FBType>, <SubAppType> or <Function>")
    root.expect_children(_TYPE_PARTS)
    header = read_header(root)
    names = with_imports(root, names)
    interface = read_interface(root, names)
    if root.tag == "Function":
        return read_function(root, header, interface, names)
    if root.tag == "SubAppType":
        body = root.child("SubAppNetwork") or root.child("FBNetwork")
        return model.SubApplicationType(header, interface, read_network(body, root.file, names))
    basic, simple, network = root.child("BasicFB"), root.child("SimpleFB"), root.child("FBNetwork")
    if basic is not None:
        return _read_basic(basic, header, interface, names)
    if simple is not None:
        return _read_simple(simple, header, interface, names)
    if network is not None:
        return model.CompositeFBType(header, interface, read_network(network, root.file, names))
    return model.ServiceInterfaceFBType(header, interface)


def read_adapter(path: Path, names: Names) -> model.AdapterType:
    """Reads an adapter type (.adp). Raises as `read_type` does."""
    root = read_xml(path)
    if root.tag != "AdapterType":
        raise root.error(f"<{root.tag}> is not an adapter type: expected <AdapterType>")
    return model.AdapterType(read_header(root), read_interface(root, with_imports(root, names)))


def _read_basic(
    body: XmlElement, header: model.TypeHeader, interface: model.Interface, names: Names
) -> model.BasicFBType:
    body.expect_children((*_ALGORITHMIC_PARTS, "ECC"))
    chart = body.child("ECC")
    if chart is None:
        raise body.error(f"basic block {header.name} has no <ECC>")
    internals, blocks = _read_internals(body, interface, names)
    algorithms = _read_algorithms(body)
    states = _read_states(chart, interface, algorithms)
    if not states:
        raise chart.error(f"the ECC of {header.name} has no state")
    chart.expect_children(("ECState", "ECTransition", "Attribute"))
    transitions = tuple(_read_transition(t, interface, states) for t in chart.children("ECTransition"))
    texts = [*(a.source.text for a in algorithms), *(t.guard for t in transitions)]
    own = [*interface.names(), *(variable.name for variable in internals)]
    constants, absent = used_constants(texts, names, own), absent_constants(texts, names, own)
    return model.BasicFBType(header, interface, internals, states, transitions, algorithms, constants, blocks, absent)


def _read_simple(
    body: XmlElement, header: model.TypeHeader, interface: model.Interface, names: Names
) -> model.SimpleFBType:
    body.expect_children((*_ALGORITHMIC_PARTS, "ECState"))
    internals, blocks = _read_internals(body, interface, names)
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
    own = [*interface.names(), *(variable.name for variable in internals)]
    texts = [algorithm.source.text for algorithm in algorithms]
    constants, absent = used_constants(texts, names, own), absent_constants(texts, names, own)
    return model.SimpleFBType(header, interface, internals, states, algorithms, constants, blocks, absent)


def _read_internals(
    body: XmlElement, interface: model.Interface, names: Names
) -> tuple[tuple[model.Variable, ...], tuple[model.InnerBlock, ...]]:
    group = body.child("InternalVars")
    blocks, inner = read_inner_blocks(group, names)
    own = (
        *read_variables(group, names, beside=("FB",)),
        *read_variables(body.child("InternalConstVars"), names, constant=True),
    )
    ports = {variable.name: variable for variable in (*interface.inputs, *interface.outputs)}
    declared: list[Named] = [*ports.values(), *own, *blocks]
    check_unique(declared, "variable", body.file)
    return (*own, *inner), blocks


def _read_algorithms(body: XmlElement) -> tuple[model.Algorithm, ...]:
    algorithms = [_read_algorithm(element) for element in body.children("Algorithm")]
    check_unique(algorithms, "algorithm", body.file)
    for method in body.children("Method"):
        # 4diac IDE keeps what it could not read in methods that nothing calls
        name = read_name(method)
        if any(re.search(rf"\b{re.escape(name)}\s*\(", a.source.text, re.IGNORECASE) for a in algorithms):
            raise method.error(f"method {name} is not supported: expected algorithms that call none")
    return tuple(algorithms)


def _read_algorithm(element: XmlElement) -> model.Algorithm:
    name = read_name(element)
    source = element.child("ST")
    if source is None:
        other = next(element.children(), None)
        language = other.get("Language", other.tag) if other is not None else "no language"
        message = f"algorithm {name} in {language} is not supported: expected Structured Text (<ST>)"
        raise ForeignLanguageError(message, element.file, element.line)
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
    if event and re.match(r"(X?OR|AND NOT)\b|[|,]", guard, re.IGNORECASE):
        raise element.error(
            f"condition {element.get('Condition')!r}: expected one event and a guard, as in {event}[X > 0]; another"
            " event has a transition of its own"
        )
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
    known = set(events)
    match = _EVENT.match(text)
    event = next((name for name in (match[0], match[1]) if name in known), "") if match else ""
    rest = text[len(event) :].strip()
    old = re.match(r"&|AND\b", rest, re.IGNORECASE) if event else None
    if old is not None:
        rest = rest[old.end() :].strip()
    elif rest.startswith("[") and rest.endswith("]"):
        rest = rest[1:-1].strip()
    return event, "" if rest == "1" else rest


def _expected(names: Sequence[str]) -> str:
    return choices(names) if names else "none, as there is none"
