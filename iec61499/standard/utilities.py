"""The blocks of 4diac FORTE's modules convert and utils: copies, arrays, structures, texts."""

from __future__ import annotations

import re
from typing import Final

from iec61499 import model
from iec61499.standard.notation import basic, function, interface, simple
from iec61499.types import ELEMENTARY, ArrayType, DataType, StructType

_COPY: Final = re.compile(r"([A-Z]+)2([A-Z]+)")
_ARRAY: Final = re.compile(r"(ARRAY2ARRAY|ARRAY2VALUES|VALUES2ARRAY)_([1-9]\d{0,3})_([A-Z]+)")
_SELECTION: Final = re.compile(r"F_SEL_E_([2-9])")
_SIZED: Final = re.compile(r"APPEND_STRING_([1-9]\d?)|F_MUX_([1-9]\d?)_([1-9]\d?)")
STRUCTURE: Final = re.compile(r"STRUCT_(MUX|DEMUX)_1(\w+)", re.ASCII)
"""Name of a block that puts a structure together or takes it apart: the structure's name follows."""


def utility(name: str) -> model.FBType | None:
    """The block of that name; None when there is none."""
    return FIXED.get(name) or _copy(name) or _array(name) or _sized(name) or _selection(name)


def structure_block(name: str, structure: StructType) -> model.SimpleFBType:
    """STRUCT_MUX_1T and STRUCT_DEMUX_1T for the structure T."""
    members = tuple(model.Variable(member.name, member.type) for member in structure.members)
    whole = (model.Variable("OUT" if name.startswith("STRUCT_MUX") else "IN", structure),)
    if name.startswith("STRUCT_MUX"):
        text = "".join(f"OUT.{member.name} := {member.name};\n" for member in members)
        return simple(name, members, whole, text)
    return simple(name, whole, members, "".join(f"{member.name} := IN.{member.name};\n" for member in members))


def _copy(name: str) -> model.SimpleFBType | None:
    match = _COPY.fullmatch(name)
    if match is None or match[1] != match[2] or match[1] not in ELEMENTARY:
        return None
    return function(name, "Copies a value", f"IN: {match[1]} -> OUT: {match[1]}", "OUT := IN;")


def _array(name: str) -> model.SimpleFBType | None:
    match = _ARRAY.fullmatch(name)
    if match is None or match[3] not in ELEMENTARY:
        return None
    kind, count, element = match[1], int(match[2]), ELEMENTARY[match[3]]
    array: DataType = ArrayType(element, 0, count - 1)
    places = range(1, count + 1)
    if kind == "ARRAY2ARRAY":
        return simple(name, (model.Variable("IN", array),), (model.Variable("OUT", array),), "OUT := IN;")
    if kind == "ARRAY2VALUES":
        outputs = tuple(model.Variable(f"OUT_{i}", element) for i in places)
        text = "".join(f"OUT_{i} := IN[{i - 1}];\n" for i in places)
        return simple(name, (model.Variable("IN", array),), outputs, text)
    inputs = tuple(model.Variable(f"IN_{i}", element) for i in places)
    return simple(
        name, inputs, (model.Variable("OUT", array),), "".join(f"OUT[{i - 1}] := IN_{i};\n" for i in places)
    )


def _selection(name: str) -> model.BasicFBType | None:
    match = _SELECTION.fullmatch(name)
    if match is None:
        return None
    numbers = range(int(match[1]))
    events = ", ".join(f"REQ{i}(IN{i})" for i in numbers)
    rows = [(f"REQ{i}", f"OUT := IN{i};", "CNF") for i in numbers]
    data = f"{', '.join(f'IN{i}' for i in numbers)}: ANY -> OUT: ANY"
    return basic(name, "Passes on the input whose event came", f"{events} -> CNF(OUT)", data, rows)


def _sized(name: str) -> model.ServiceInterfaceFBType | None:
    match = _SIZED.fullmatch(name)
    if match is None:
        return None
    if match[1]:
        inputs = [f"IN_{i}" for i in range(1, int(match[1]) + 1)]
        return _service(name, f"REQ({' '.join(inputs)}) -> CNF(OUT)", f"{', '.join(inputs)}: ANY -> OUT: STRING")
    rows, columns = range(1, int(match[2]) + 1), range(1, int(match[3]) + 1)
    events = ", ".join(f"EI{i}({' '.join(f'IN_{i}_{k}' for k in columns)})" for i in rows)
    outputs = [f"OUT_{k}" for k in columns]
    inputs = [f"IN_{i}_{k}" for i in rows for k in columns]
    return _service(
        name,
        f"{events} -> EO(QO STATUS {' '.join(outputs)})",
        f"{', '.join(inputs)}: ANY -> QO: BOOL; STATUS: WSTRING; {', '.join(outputs)}: ANY",
    )


def _service(name: str, events: str, data: str) -> model.ServiceInterfaceFBType:
    return model.ServiceInterfaceFBType(model.TypeHeader(name), interface(events, data))


_RANDOM: Final = basic(
    "FB_RANDOM",
    "Numbers from 0 to below 1, the same ones for the same SEED",
    "INIT(SEED), REQ -> INITO, CNF(VAL)",
    "SEED: UINT -> VAL: REAL",
    [
        ("INIT", "STATE := SEED;", "INITO"),
        # the linear congruential generator of Numerical Recipes, section 7.1, and its upper 24 bits
        ("REQ", "STATE := STATE * 1664525 + 1013904223; VAL := UDINT_TO_REAL(STATE / 256) / 16777216.0;", "CNF"),
    ],
    "STATE: UDINT",
)

FIXED: Final[dict[str, model.FBType]] = {
    "FB_RANDOM": _RANDOM,
    "GET_AT_INDEX": _service(
        "GET_AT_INDEX", "REQ(IN_ARRAY INDEX) -> CNF(QO OUT)", "IN_ARRAY: ANY; INDEX: UINT -> QO: BOOL; OUT: ANY"
    ),
    "SET_AT_INDEX": _service(
        "SET_AT_INDEX",
        "REQ(IN_ARRAY INDEX VALUE) -> CNF(QO OUT_ARRAY)",
        "IN_ARRAY: ANY; INDEX: UINT; VALUE: ANY -> QO: BOOL; OUT_ARRAY: ANY",
    ),
    "GET_STRUCT_VALUE": _service(
        "GET_STRUCT_VALUE",
        "REQ(in_struct member) -> CNF(QO output)",
        "in_struct: ANY; member: STRING -> QO: BOOL; output: ANY",
    ),
    "SET_STRUCT_VALUE": _service(
        "SET_STRUCT_VALUE",
        "REQ(in_struct member element_value) -> CNF(out_struct)",
        "in_struct: ANY; member: STRING; element_value: ANY -> out_struct: ANY",
    ),
    "TEST_CONDITION": _service("TEST_CONDITION", "REQ(check) -> CNF", "check: BOOL ->"),
    "OUT_ANY_CONSOLE": _service(
        "OUT_ANY_CONSOLE", "REQ(QI LABEL IN) -> CNF(QO)", "QI: BOOL; LABEL: STRING; IN: ANY -> QO: BOOL"
    ),
    "STEST_END": _service("STEST_END", "REQ ->", ""),
}
"""The blocks whose name carries no size, by name."""
