"""Reads the blocks inside basic and simple blocks, `<FB>` among the internal variables, as 4diac IDE writes them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from iec61499 import model
from iec61499.errors import choices
from iec61499.files.header import read_name
from iec61499.files.names import Names, resolved
from iec61499.files.xml import XmlElement


def read_inner_blocks(
    group: XmlElement | None, names: Names
) -> tuple[tuple[model.InnerBlock, ...], tuple[model.Variable, ...]]:
    """The blocks of a group of internal variables, and their variables, called `BLOCK.VARIABLE`.

    Raises:
        FunctionBlockError: an unknown type, or one that cannot stand inside another block; names file and line.
    """
    blocks: list[model.InnerBlock] = []
    variables: list[model.Variable] = []
    for element in group.children("FB") if group is not None else ():
        element.expect_children(("Parameter", "Attribute"))
        found = names.block(element.require("Type"), element.file, element.line)
        kind = _standing_inside(found, element)
        inner = model.InnerBlock(read_name(element), kind, element.get("Comment"), element.line)
        blocks.append(inner)
        variables += _variables(inner, element, names)
    return tuple(blocks), tuple(variables)


def _standing_inside(found: model.LibraryElement, element: XmlElement) -> model.FBType:
    name = found.header.name
    if isinstance(found, model.SubApplicationType | model.CompositeFBType):
        raise element.error(f"{name} inside a basic or simple block is a network: expected a basic or simple block")
    for adapter in found.interface.adapters:
        raise element.error(f"{name} inside a basic or simple block has the adapter {adapter.name}: expected none")
    for variable in (*found.interface.inputs, *found.interface.outputs):
        if isinstance(variable.type, model.GenericType):
            raise element.error(
                f"{name} inside a basic or simple block: {variable.name} is {variable.type}, which no connection "
                "tells there: expected a type that is not generic"
            )
    return found


def _variables(inner: model.InnerBlock, element: XmlElement, names: Names) -> Iterator[model.Variable]:
    interface = inner.type.interface
    inputs = [variable.name for variable in interface.inputs]
    given = {}
    for parameter in element.children("Parameter"):
        if parameter.get("Name") not in inputs:
            expected = choices(inputs) if inputs else "none"
            raise parameter.error(f"{inner.name} has no data input {parameter.get('Name')}: expected {expected}")
        given[parameter.get("Name")] = resolved(parameter.get("Value"), names)
    own = getattr(inner.type, "internals", ())
    ports = {variable.name: variable for variable in (*interface.inputs, *interface.outputs, *own)}
    for variable in ports.values():
        initial = given.get(variable.name, variable.initial)
        found = replace(variable, name=f"{inner.name}.{variable.name}", initial=initial, line=element.line)
        model.initial_value(found, element.file)
        yield found
