"""Basic and simple blocks as types that are built into a 4diac FORTE: C for each, and one C++ file for all of them.

The module is a folder for FORTE's own build. Each type is a C file with its state, the functions of its algorithms
and events (as `native.blocks` makes them), and tables of its ports; `forte/blocks.cpp` reads the tables and fits
FORTE 2.0 and the development versions of 3.0. The name of a type ends with a digest of all these texts: a FORTE that
has a type of that name does what they say.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path, PurePath
from typing import Final

from iec61499 import model
from iec61499.deploy.device_type import Algorithmic, DeviceType, digested
from iec61499.deploy.lua_export import PORT_LIMIT
from iec61499.errors import FunctionBlockError
from iec61499.native.blocks import OUTPUTS, STATE, block_code, structure
from iec61499.native.build import FLAGS, HEADER
from iec61499.st.ast import Position
from iec61499.st.c.expressions import Places
from iec61499.st.c.names import c_name, initialiser, quoted
from iec61499.types import ArrayType, ElementaryType

_KINDS: Final = ("bool", "signed", "unsigned", "bits", "real", "string", "time")
"""What FORTE 2.0 and 3.0 hold in the same way."""
_OTHER_FLAGS: Final = ("-O1", "-shared")
_EXTERN_C: Final = ("#ifdef __cplusplus", 'extern "C" {', "#endif")
_END_EXTERN_C: Final = ("#ifdef __cplusplus", "}", "#endif")
_INDENT: Final = "    "


def built_in_type(block: Algorithmic) -> DeviceType:
    """The block as a type that a FORTE has built in.

    Raises:
        FunctionBlockError: an algorithm or condition is wrong or beyond C, or FORTE does not hold a variable as C
            does; names file and line.
    """
    text = "\n".join([*_code(block), *_tables(block), *_wrapper().values()])
    name = digested(block, text, built_in=True)
    return DeviceType(name, "", replace(block, header=replace(block.header, name=name)))


def module_files(name: str, types: Iterable[DeviceType]) -> dict[str, str]:
    """The files of a module of types, by their paths below the folder that FORTE_EXTERNAL_MODULES_DIRECTORY names.

    Args:
        name: a C identifier, the name of the module and its folder.
        types: what `built_in_type` gives.

    Raises:
        FunctionBlockError: as `built_in_type`.
    """
    blocks = {c_name(kind.name): kind.block for kind in types}
    sources = {f"{symbol}.c": _source(block) for symbol, block in blocks.items()}
    sources["module.c"] = _text(
        [
            '#include "module.h"',
            "",
            f"const struct dtwin_type *const {name}_types[] = {{",
            *(f"{_INDENT}&{symbol}," for symbol in blocks),
            f"{_INDENT}NULL,",
            "};",
        ]
    )
    header = [
        '#include "types.h"',
        "",
        *_EXTERN_C,
        *(f"extern const struct dtwin_type {symbol};" for symbol in blocks),
        "/* All of them; NULL ends them. */",
        f"extern const struct dtwin_type *const {name}_types[];",
        *_END_EXTERN_C,
        "",
        f"#define DTWIN_MODULE {name}_types",
    ]
    build = [
        f"forte_add_module({name.upper()} ON \"Block types written by 'dtwin fb export --format forte'\")",
        f"forte_add_sourcefile_cpp({name}_blocks.cpp)",
        f"add_library({name}_types STATIC {' '.join(sources)})",
        f"target_compile_options({name}_types PRIVATE {' '.join(f for f in FLAGS if f not in _OTHER_FLAGS)})",
        f"forte_add_link_library({name}_types)",
    ]
    # FORTE's build wants C++ files of different names in all modules
    wrapper = {f"{name}_{file}" if file.endswith(".cpp") else file: text for file, text in _wrapper().items()}
    files = {**wrapper, **sources, "module.h": _text(header), "CMakeLists.txt": _text(build)}
    return {f"{name}/{file}": text for file, text in files.items()}


@cache
def _wrapper() -> dict[str, str]:
    """The files that are the same for all types."""
    own = Path(__file__).parent / "forte"
    return {file.name: file.read_text() for file in (HEADER, *sorted(own.iterdir()))}


def _source(block: Algorithmic) -> str:
    head = f"/* {block.header.name}; written by `dtwin fb export --format forte`. */"
    return _text([head, *_code(block), *_tables(block), *_entry(block)])


def _code(block: Algorithmic) -> list[str]:
    """The state of a block, its functions, and its execution."""
    places = Places()
    places.number(Position("", 0, 0))
    code = block_code(block, "block", places)
    lines = ['#include "types.h"', "", *structure(code), *code.lines]
    lines += ["", "static void execute(void *state, struct fb_run *run, uint16_t event)", "{"]
    lines += [f"{_INDENT}switch (event) {{"]
    for number, event in enumerate(block.interface.event_inputs):
        call = f"{code.handlers[event.name]}(state, run);"
        lines += [f"{_INDENT}case {number}: /* {event.name} */", f"{_INDENT * 2}{call}", f"{_INDENT * 2}break;"]
    lines += [f"{_INDENT}default:", f"{_INDENT * 2}(void)state;", f"{_INDENT * 2}(void)run;", f"{_INDENT * 2}break;"]
    lines += [f"{_INDENT}}}", "}", "", f"static const struct {code.tag} initial = {{", f"{_INDENT}.{OUTPUTS} = 0,"]
    lines += [f"{_INDENT}.{field.name} = {initialiser(field.initial, field.type)}," for field in code.fields]
    lines += ["};", "", "static const struct fb_place places[] = {"]
    lines += [f"{_INDENT}{{{quoted(PurePath(at[0]).name)}, {at[1]}, {at[2]}}}," for at in places.found] + ["};"]
    return lines


def _tables(block: Algorithmic) -> list[str]:
    """The tables of the ports and variables of a block."""
    ports = block.interface
    data = [variable.name for variable in (*ports.inputs, *ports.outputs)]
    for adapter in ports.adapters:
        raise FunctionBlockError(
            f"adapter {adapter.name} of {block.header.name} cannot be built in: expected events and data",
            block.header.file,
            adapter.line,
        )
    lines: list[str] = []
    for name, events, offset in (
        ("event_inputs", ports.event_inputs, 0),
        ("event_outputs", ports.event_outputs, len(ports.inputs)),
    ):
        rows = []
        for event in events:
            row = "NULL"
            if event.with_variables:
                row = f"with_{c_name(event.name)}"
                numbers = [str(data.index(variable) - offset) for variable in event.with_variables]
                lines += ["", f"static const int16_t {row}[] = {{{', '.join([*numbers, '-1'])}}};"]
            rows.append(f"{{{quoted(event.name)}, {quoted(event.type)}, {row}}}")
        lines += _array("struct dtwin_event", name, rows)
    for name, variables in (("inputs", ports.inputs), ("outputs", ports.outputs), ("internals", block.internals)):
        lines += _array("struct dtwin_data", name, [_row(block, variable) for variable in variables])
    for group in (ports.event_inputs, ports.event_outputs, ports.inputs, ports.outputs, block.internals):
        if len(group) >= PORT_LIMIT:
            raise FunctionBlockError(
                f"{block.header.name} has {len(group)} ports of one kind: expected at most {PORT_LIMIT - 1} in FORTE",
                block.header.file,
                group[PORT_LIMIT - 1].line,
            )
    return lines


def _row(block: Algorithmic, variable: model.Variable) -> str:
    kind = variable.type
    element = kind.element if isinstance(kind, ArrayType) else kind
    if not isinstance(element, ElementaryType) or element.kind not in _KINDS:
        raise FunctionBlockError(
            f"variable {variable.name}: {kind} cannot be built into 4diac FORTE: expected a number, BOOL, bits, TIME "
            "or STRING, or an array of these with one dimension",
            block.header.file,
            variable.line,
        )
    name = "STRING" if element.kind == "string" else element.name
    length, lower = (kind.length, kind.lower) if isinstance(kind, ArrayType) else (0, 0)
    place = f"offsetof(struct block, {c_name(variable.name)})"
    return f"{{{quoted(variable.name)}, {quoted(name)}, {place}, {length}, {lower}}}"


def _array(kind: str, name: str, rows: Sequence[str]) -> list[str]:
    """A table; C has none without rows."""
    if not rows:
        return ["", f"#define {name} NULL"]
    return ["", f"static const {kind} {name}[] = {{", *(f"{_INDENT}{row}," for row in rows), "};"]


def _entry(block: Algorithmic) -> list[str]:
    """What the module knows of the type."""
    ports = block.interface
    groups = (ports.event_inputs, ports.event_outputs, ports.inputs, ports.outputs, block.internals)
    chart = f"offsetof(struct block, {STATE})" if isinstance(block, model.BasicFBType) else "sizeof(struct block)"
    name = c_name(block.header.name)
    lines = ["", f"extern const struct dtwin_type {name};", f"const struct dtwin_type {name} = {{"]
    lines += [f"{_INDENT}{quoted(block.header.name)}, sizeof(struct block), &initial, {chart},"]
    lines += [f"{_INDENT}event_inputs, event_outputs, inputs, outputs, internals,"]
    lines += [f"{_INDENT}{', '.join(str(len(group)) for group in groups)},", f"{_INDENT}execute, places,", "};"]
    return lines


def _text(lines: Iterable[str]) -> str:
    return "".join(f"{line}\n" for line in lines)
