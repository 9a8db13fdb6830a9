"""What the blocks of 4diac FORTE's module utils do whose types only connections give."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from typing import Any, Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.literals import format_literal
from iec61499.runtime.checks import EndOfTest
from iec61499.runtime.service_interface import ServiceBehaviour
from iec61499.types import ArrayType, DataType, StructType

log = logging.getLogger(__name__)
_MULTIPLEXER: Final = re.compile(r"F_MUX_(\d+)_(\d+)")


def behaviour(block: model.ServiceInterfaceFBType) -> ServiceBehaviour | None:
    """The behaviour of such a block; None for any other block."""
    name = block.header.name
    types = {v.name: v.type for v in (*block.interface.inputs, *block.interface.outputs)}
    sizes = _MULTIPLEXER.fullmatch(name)
    if sizes is not None:
        return ServiceBehaviour({f"EI{i}": _select(i, int(sizes[2]), types) for i in range(1, int(sizes[1]) + 1)})
    if name.startswith("APPEND_STRING_"):
        return ServiceBehaviour({"REQ": _appender([(v.name, v.type) for v in block.interface.inputs])})
    make = _MAKERS.get(name)
    return ServiceBehaviour({"REQ": make(types)}) if make is not None else None


Types = dict[str, Any]
Handler = Callable[[Any], None]


def _element_getter(types: Types) -> Handler:
    array = types["IN_ARRAY"]
    fits = isinstance(array, ArrayType) and array.element == types["OUT"]

    def get(s: Any) -> None:
        s.QO = fits and len(s.IN_ARRAY) > s.INDEX
        if s.QO:
            s.OUT = s.IN_ARRAY[s.INDEX]
        s.extend__(s.to__CNF)

    return get


def _element_setter(types: Types) -> Handler:
    array, result = types["IN_ARRAY"], types["OUT_ARRAY"]
    fits = isinstance(array, ArrayType) and isinstance(result, ArrayType) and array.element == result.element
    fits = fits and array.element == types["VALUE"] and result.length >= array.length

    def set_element(s: Any) -> None:
        s.QO = fits and len(s.IN_ARRAY) > s.INDEX
        if s.QO:
            values = [*s.IN_ARRAY, *s.OUT_ARRAY[len(s.IN_ARRAY) :]]
            values[s.INDEX] = s.VALUE
            s.OUT_ARRAY = values
        s.extend__(s.to__CNF)

    return set_element


def _member_getter(types: Types) -> Handler:
    structure, wanted = types["in_struct"], types["output"]

    def get(s: Any) -> None:
        places, data_type = _path(structure, s.member)
        s.QO = data_type == wanted
        if s.QO:
            value = s.in_struct
            for place in places:
                value = value[place]
            s.output = value
        s.extend__(s.to__CNF)

    return get


def _member_setter(types: Types) -> Handler:
    structure, given = types["in_struct"], types["element_value"]
    fits = structure == types["out_struct"]

    def set_member(s: Any) -> None:
        places, data_type = _path(structure, s.member)
        if fits:
            s.out_struct = _replaced(s.in_struct, places, s.element_value) if data_type == given else s.in_struct
        s.extend__(s.to__CNF)

    return set_member


def _path(data_type: Any, name: str) -> tuple[list[int], Any]:
    """Where the member `A.B` of a structure is, and its type; None for one that is not there."""
    places = []
    for part in name.split("."):
        place = data_type.index(part) if isinstance(data_type, StructType) else None
        if place is None:
            return [], None
        places.append(place)
        data_type = data_type.members[place].type
    return places, data_type


def _replaced(value: list[Any], places: list[int], new: Any) -> list[Any]:
    """The structure with another value of one member."""
    place, *rest = places
    inner = _replaced(value[place], rest, new) if rest else new
    return [*value[:place], inner, *value[place + 1 :]]


def _select(row: int, columns: int, types: Types) -> Handler:
    pairs = [(f"IN_{row}_{k}", f"OUT_{k}") for k in range(1, columns + 1)]
    fits = all(types[source] == types[destination] for source, destination in pairs)

    def select(s: Any) -> None:
        for source, destination in pairs if fits else ():
            setattr(s, destination, getattr(s, source))
        s.QO, s.STATUS = fits, "OK" if fits else "Datatype ERROR"
        s.extend__(s.to__EO)

    return select


def _appender(inputs: list[tuple[str, Any]]) -> Handler:
    def append(s: Any) -> None:
        s.OUT = "".join(_text(getattr(s, name), data_type) for name, data_type in inputs)
        s.extend__(s.to__CNF)

    return append


def _tester(types: Types) -> Handler:
    def test(s: Any) -> None:
        log.log(logging.INFO if s.check else logging.ERROR, "%s %s", s.name__, "passed" if s.check else "failed")
        s.resource__.checks.add(s.name__, s.check)
        s.extend__(s.to__CNF)

    return test


def _printer(types: Types) -> Handler:
    def show(s: Any) -> None:
        s.QO = s.QI
        if s.QI:
            log.warning("%s: %s%s", s.name__, s.LABEL, _text(s.IN, types["IN"]))
        s.extend__(s.to__CNF)

    return show


def _ender(types: Types) -> Handler:
    def end(s: Any) -> None:
        raise EndOfTest(f"{s.name__}.REQ: the test has ended")

    return end


def _text(value: Any, data_type: DataType) -> str:
    """Texts without quotes, everything else as its literal."""
    if isinstance(value, str):
        return value
    try:
        return format_literal(value, data_type)
    except FunctionBlockError:
        return str(value)


_MAKERS: Final[dict[str, Callable[[Types], Handler]]] = {
    "GET_AT_INDEX": _element_getter,
    "SET_AT_INDEX": _element_setter,
    "GET_STRUCT_VALUE": _member_getter,
    "SET_STRUCT_VALUE": _member_setter,
    "TEST_CONDITION": _tester,
    "OUT_ANY_CONSOLE": _printer,
    "STEST_END": _ender,
}
