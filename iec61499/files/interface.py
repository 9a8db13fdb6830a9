"""Reads interface lists and variable declarations: events, data ports, internal variables and their types."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from iec61499 import model
from iec61499.errors import FunctionBlockError, choices
from iec61499.files.header import Named, check_unique, read_name
from iec61499.files.names import Names, resolved
from iec61499.files.xml import XmlElement
from iec61499.types import GENERIC_TYPES, ArrayType

_PORT_GROUPS: Final = ("EventInputs", "EventOutputs", "InputVars", "OutputVars")
_ADAPTER_GROUPS: Final = ("Plugs", "Sockets")


def read_interface(owner: XmlElement, names: Names) -> model.Interface:
    """The ports declared by the interface list of a type or subapplication; none without such a list."""
    interface = owner.child("InterfaceList") or owner.child("SubAppInterfaceList")
    if interface is None:
        return model.Interface()
    groups: dict[str, XmlElement] = {}
    interface.expect_children(
        [*_PORT_GROUPS, *_ADAPTER_GROUPS, "InOutVars", *(f"SubApp{group}" for group in _PORT_GROUPS)]
    )
    for group in interface.children():
        groups[group.tag.removeprefix("SubApp")] = group
    # the result of a function has no name; in its text it is called as the function
    result = owner.get("Name") if owner.tag == "Function" else ""
    inputs = read_variables(groups.get("InputVars"), names)
    outputs = read_variables(groups.get("OutputVars"), names, unnamed=result)
    in_outs = _read_in_outs(owner, groups.get("InOutVars"), names)
    # services of 4diac name data that they do not have, as IE does
    is_service = owner.tag == "FBType" and not any(owner.child(body) for body in ("BasicFB", "SimpleFB", "FBNetwork"))
    events = (
        _read_events(groups.get("EventInputs"), inputs, in_outs, "input", is_service, ""),
        _read_events(groups.get("EventOutputs"), outputs, in_outs, "output", is_service, result),
    )
    adapters = tuple(
        model.AdapterPort(
            read_name(element),
            names.adapter(element.require("Type"), element.file, element.line),
            group == "Plugs",
            element.get("Comment"),
            element.line,
        )
        for group in _ADAPTER_GROUPS
        for element in (groups[group].children("AdapterDeclaration") if group in groups else ())
    )
    data: list[Named] = [*inputs, *outputs, *in_outs, *adapters]
    check_unique([*events[0], *events[1]], "port", owner.file)
    check_unique(data, "port", owner.file)
    # an event and a variable may differ in case alone, as nothing in Structured Text names an event
    check_unique([*events[0], *events[1], *data], "port", owner.file, same_case=True)
    both = tuple(variable.name for variable in in_outs)
    return with_adapters(model.Interface(*events, (*inputs, *in_outs), (*outputs, *in_outs), (), both), adapters)


def _read_in_outs(owner: XmlElement, group: XmlElement | None, names: Names) -> tuple[model.Variable, ...]:
    in_outs = read_variables(group, names)
    for variable in in_outs:
        if owner.tag not in ("FBType", "Function") or isinstance(variable.type, model.GenericType):
            raise FunctionBlockError(
                f"VAR_IN_OUT {variable.name} is not supported here: expected one of a block, not of an adapter or "
                "subapplication, and of a type that is not generic",
                owner.file,
                variable.line,
            )
    return in_outs


def with_adapters(interface: model.Interface, adapters: Sequence[model.AdapterPort]) -> model.Interface:
    """The interface with the ports of its plugs and sockets, `ADAPTER.PORT` each.

    An adapter type is written as a socket's block sees it from inside: what the type calls an output comes in from
    outside. A plug has the same ports the other way round.
    """
    event_inputs, event_outputs = list(interface.event_inputs), list(interface.event_outputs)
    inputs, outputs = list(interface.inputs), list(interface.outputs)
    for adapter in adapters:
        ports = adapter.type.interface
        into, out_of = (ports.event_inputs, ports.inputs), (ports.event_outputs, ports.outputs)
        if not adapter.is_plug:
            into, out_of = out_of, into
        event_inputs += [_event(adapter, event) for event in into[0]]
        inputs += [_variable(adapter, variable) for variable in into[1]]
        event_outputs += [_event(adapter, event) for event in out_of[0]]
        outputs += [_variable(adapter, variable) for variable in out_of[1]]
    return replace(
        interface,
        event_inputs=tuple(event_inputs),
        event_outputs=tuple(event_outputs),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        adapters=tuple(adapters),
    )


def _event(adapter: model.AdapterPort, event: model.EventPort) -> model.EventPort:
    data = tuple(f"{adapter.name}.{variable}" for variable in event.with_variables)
    return replace(event, name=f"{adapter.name}.{event.name}", with_variables=data, line=adapter.line)


def _variable(adapter: model.AdapterPort, variable: model.Variable) -> model.Variable:
    return replace(variable, name=f"{adapter.name}.{variable.name}", line=adapter.line)


def _read_events(
    group: XmlElement | None,
    variables: Sequence[model.Variable],
    in_outs: Sequence[model.Variable],
    direction: str,
    is_service: bool,
    unnamed: str,
) -> tuple[model.EventPort, ...]:
    names = [variable.name for variable in variables]
    shared = [variable.name for variable in in_outs]
    events = []
    if group is None:
        return ()
    group.expect_children(("Event", "SubAppEvent"))
    for element in group.children():
        element.expect_children(("With", "Attribute"))
        with_variables = tuple(w.get("Var") or unnamed or w.require("Var") for w in element.children("With"))
        for with_element, name in zip(element.children("With"), with_variables, strict=True):
            if name not in names and name not in shared and not is_service:
                valid = f"expected {choices(names)}" if names else f"the type has no {direction} variable"
                raise with_element.error(
                    f"unknown {direction} variable {name} in WITH of {element.get('Name')}: {valid}"
                )
        # a VAR_IN_OUT is not sampled: both sides have the same variable
        sampled = tuple(name for name in with_variables if name in names)
        kind = element.get("Type").rpartition("::")[2] or "Event"
        events.append(model.EventPort(read_name(element), sampled, element.get("Comment"), element.line, kind))
    return tuple(events)


def read_variables(
    group: XmlElement | None,
    names: Names,
    constant: bool = False,
    beside: tuple[str, ...] = (),
    unnamed: str = "",
) -> tuple[model.Variable, ...]:
    """The variable declarations of a group; with `constant` they cannot be assigned.

    Elements of the tags `beside` may stand among them. One without a name is called `unnamed`, if that is given.
    """
    variables = []
    if group is None:
        return ()
    group.expect_children(("VarDeclaration", *beside))
    for element in group.children("VarDeclaration"):
        element.expect_children(("Attribute",))
        name = read_name(element) if element.get("Name") or not unnamed else unnamed
        initial = resolved(element.get("InitialValue"), names)
        variable = model.Variable(
            name, _variable_type(element, names), initial, element.get("Comment"), element.line, constant
        )
        model.initial_value(variable, element.file)
        variables.append(variable)
    return tuple(variables)


def _variable_type(element: XmlElement, names: Names) -> model.VariableType:
    name = element.require("Type")
    if name.upper().startswith("ANY"):
        if element.get("ArraySize"):
            raise element.error(f"array of {name} is not supported: expected an elementary type")
        if name.upper() not in GENERIC_TYPES:
            raise element.error(f"unknown generic type {name}: expected {choices(GENERIC_TYPES)}")
        return model.GenericType(name.upper())
    try:
        data_type = names.data_type(name)
        return _array_type(element, data_type) if element.get("ArraySize") else data_type
    except FunctionBlockError as error:
        raise element.error(f"variable {element.get('Name')}: {error.message}") from None


def _array_type(element: XmlElement, data_type: model.DataType) -> ArrayType:
    """`4` is 0..3; `1..3`; several dimensions are separated by commas, the first is the outermost."""
    for dimension in reversed(element.get("ArraySize").split(",")):
        bounds = re.fullmatch(r"\s*(-?\d{1,9})\s*(?:\.\.\s*(-?\d{1,9})\s*)?", dimension)
        if dimension.strip() == "*":
            raise element.error("arrays of any size (*) are not supported: expected a number or bounds such as 1..3")
        if bounds is None:
            raise element.error(f"array size {element.get('ArraySize')!r}: expected a number or bounds such as 1..3")
        lower, upper = (0, int(bounds[1]) - 1) if bounds[2] is None else (int(bounds[1]), int(bounds[2]))
        data_type = ArrayType(data_type, lower, upper)
    assert isinstance(data_type, ArrayType)
    return data_type
