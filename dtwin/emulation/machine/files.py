"""Machines as files: `machines/*.toml`, any other TOML or JSON file of the same form, and their text.

    name = "servo"

    [drive]
    lag = 0.002                    # one number for all joints
    dead_zone = [0.1, 0.15, 0.15]  # or one for each

What a file leaves out is ideal.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import msgspec

from dtwin.emulation.machine.sections import IDEAL, SECTIONS, Machine, Section, declared
from dtwin.errors import ModelError, ParameterError, choices
from dtwin.parameters import JOINTS, ROOT, JointVector, every_joint

FOLDER: Final = ROOT / "machines"
"""Folder of the named machines."""
_SUFFIXES: Final = (".toml", ".json")


def names() -> list[str]:
    """Names of the machines: ideal, and those of the files in `machines/`."""
    return [IDEAL.name, *sorted(path.stem for path in FOLDER.glob("*.toml"))]


def is_file(text: str) -> bool:
    """Whether a text stands for the file of a machine, not for a name or a number."""
    return text.endswith(_SUFFIXES)


def machine_of(text: str) -> Machine:
    """The machine that a name, a file (*.toml, *.json) or a number stands for.

    Raises:
        ModelError: there is no such machine, or its file cannot be read.
        ParameterError: a number of the machine is out of range.
    """
    if text == IDEAL.name:
        return IDEAL
    if is_file(text):
        return load(Path(text))
    if text.isascii() and text.isdecimal():
        from dtwin.emulation.machine.drawing import draw  # numpy's generators are loaded for drawn machines alone

        return draw(int(text))
    if text not in names():
        raise ModelError(f"machine {text!r}: expected a file (*.toml, *.json), a number, or {choices(names())}")
    return load(FOLDER / f"{text}.toml")


def load(path: Path) -> Machine:
    """Reads a machine; what the file leaves out is ideal, and it is called as its file where it has no name.

    Raises:
        ModelError: the file cannot be read, or holds what no machine has.
        ParameterError: a number is out of range.
    """
    decode = msgspec.json.decode if path.suffix == ".json" else msgspec.toml.decode
    try:
        content = decode(path.read_bytes())
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise ModelError(f"{path}: expected a machine: {error}") from None
    try:
        return machine_from(content, path.stem)
    except (ModelError, ParameterError) as error:
        raise type(error)(f"{path}: {error}") from None


def machine_from(content: object, called: str) -> Machine:
    """The machine of what a file, or the metadata of a log, says: a name and sections.

    Args:
        content: what it says.
        called: name where it has none.

    Raises:
        ModelError: it holds what no machine has.
        ParameterError: a number of the machine is out of range.
    """
    if not isinstance(content, dict):
        raise ModelError(f"expected a machine with the sections {choices(SECTIONS)}")
    for key in content:
        if key != "name" and key not in SECTIONS:
            raise ModelError(f"unknown section {key!r}: expected {choices(('name', *SECTIONS))}")
    name = content.get("name", called)
    if not isinstance(name, str):
        raise ModelError(f"name: expected a text, got {name!r}")
    parts = {section: _section(section, kind, content.get(section, {})) for section, kind in SECTIONS.items()}
    return Machine(name, **parts)  # type: ignore[arg-type]  # SECTIONS tells each type


def toml(machine: Machine) -> str:
    """The text of a machine, which `load` reads back as an equal one."""
    lines = [f"name = {_toml(machine.name)}"]
    for section, values in machine.effects().items():
        lines += ["", f"[{section}]", *(f"{name} = {_toml(value)}" for name, value in values.items())]
    return "\n".join(lines) + "\n"


def _section(name: str, kind: type[Section], content: Any) -> Section:
    if not isinstance(content, dict):
        raise ModelError(f"{name}: expected a section, got {content!r}")
    known = declared(kind)
    values = {}
    for key, value in content.items():
        if key not in known:
            raise ModelError(f"unknown key {name}.{key}: expected {choices(known)}")
        values[key] = _value(f"{name}.{key}", value, known[key][0])
    return kind(**values)


def _value(where: str, value: Any, kind: Any) -> Any:
    if kind is int:
        if type(value) is not int:
            raise ModelError(f"{where}: expected a whole number, got {value!r}")
        return value
    if kind is bool:
        if type(value) is not bool:
            raise ModelError(f"{where}: expected true or false, got {value!r}")
        return value
    if kind is float:
        return _number(where, value, "a number")
    if kind is not JointVector:
        return value
    if isinstance(value, list | tuple):
        return tuple(_number(where, item, f"a number for each of the {JOINTS} joints") for item in value)
    return every_joint(_number(where, value, "a number or three"))


def _number(where: str, value: Any, expected: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ModelError(f"{where}: expected {expected}, got {value!r}")
    return float(value)


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(repr, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    # TOML escapes as JSON does, and DEL beside.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f") if isinstance(value, str) else repr(value)
