"""The C sources of the models: hand-written ones of the folder `c`, and those that follow from the variables."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

from dtwin.fmu.ranges import FARTHEST_TIME, LONGEST_DURATION
from dtwin.fmu.variables import Variable
from dtwin.parameters import GRAVITY, PERIOD, VOLTAGE_LIMIT
from iec61499.native.build import unit_files
from iec61499.native.layout import Layout
from iec61499.native.unit import unit_of

Subject = Literal["twin", "controller", "cell"]
Version = Literal["3.0", "2.0"]
PROGRAM: Final = "program"
"""Name of the C unit of the function blocks."""
_FOLDER: Final = Path(__file__).parent / "c"
_ARM: Final = ("arm.h", "arm_state.h", "arm.c", "equations.h")
_CONTROL: Final = ("control.h", "control_state.h", "control.c", "tick.c")
_PARTS: Final[dict[Subject, tuple[str, ...]]] = {
    "twin": _ARM,
    "controller": _CONTROL,
    "cell": (*_ARM, *_CONTROL, "exchange.h"),
}
_TYPES: Final = {
    "Float64": "MODEL_REAL",
    "Int32": "MODEL_INTEGER",
    "Boolean": "MODEL_BOOLEAN",
    "String": "MODEL_TEXTUAL",
}
_CLOCK_ROUNDING: Final = 1e-9
"""Time by which a tick may seem early or late from rounding near time 0, s."""
_TIME_ROUNDING: Final = 1e-6
"""Time by which a simulator's communication points may differ from the sum of its steps near time 0, s."""


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """What the C files of a model hold beside what those of all models do.

    Attributes:
        texts: the texts of further files, by name; SUBJECT.h among them defines `struct model`.
        period: time from one sample of the controller to the next, s.
        start: what is set at the beginning beside variables: literals of C by the lvalue below the model.
        constants: further whole numbers for constants.h, by name.
    """

    texts: Mapping[str, str]
    period: float = PERIOD
    start: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, int] = field(default_factory=dict)


def parts_of(subject: Subject) -> Parts:
    """The parts of a model with the arm of the cell."""
    return Parts(texts_of((f"{subject}.h", f"{subject}.c", *_PARTS[subject])))


def texts_of(names: Sequence[str], folder: str = "") -> dict[str, str]:
    """The texts of hand-written files by their names: those of a folder below `c`, or else of `c` itself."""
    places = {name: _FOLDER / folder / name for name in names}
    return {name: (place if place.is_file() else _FOLDER / name).read_text() for name, place in places.items()}


def source_files(
    subject: Subject, version: Version, variables: Sequence[Variable], layout: Layout | None, parts: Parts
) -> dict[str, str]:
    """The texts of all C files of a model, by name.

    Args:
        subject: the model.
        version: version of FMI.
        variables: its variables.
        layout: the layout of the function blocks, if it has some.
        parts: what it consists of.
    """
    number = version[0]
    names = [
        f"fmi{number}.h",
        f"fmi{number}.c",
        "calls.h",
        "calls.c",
        "instance.h",
        "instance.c",
        "snapshots.c",
        "model.h",
    ]
    texts = {**texts_of(names), **parts.texts}
    if layout is not None:
        texts |= unit_files(unit_of(layout, PROGRAM), PROGRAM)
    texts["constants.h"] = _constants(parts)
    token = token_of((variables, sorted(parts.start.items())), texts)
    return texts | {"variables.c": _table(subject, variables, parts, token)}


def token_of(values: object, texts: dict[str, str]) -> str:
    """What tells a model from others: equal sources and values have equal tokens."""
    digest = hashlib.sha256(repr(values).encode())
    for name, text in sorted(texts.items()):
        digest.update(f"{name}\0{text}\0".encode())
    hexadecimal = digest.hexdigest()
    parts = (hexadecimal[0:8], hexadecimal[8:12], hexadecimal[12:16], hexadecimal[16:20], hexadecimal[20:32])
    return f"{{{'-'.join(parts)}}}"


def _constants(parts: Parts) -> str:
    values = {
        "GRAVITY": GRAVITY,
        "VOLTAGE_LIMIT": VOLTAGE_LIMIT,
        "PERIOD": parts.period,
        "CLOCK_ROUNDING": _CLOCK_ROUNDING,
        "TIME_ROUNDING": _TIME_ROUNDING,
        "LONGEST_DURATION": LONGEST_DURATION,
        "FARTHEST_TIME": FARTHEST_TIME,
        **parts.constants,
    }
    lines = [f"#define {name} {value!r}" for name, value in values.items()]
    return "\n".join(["/* Numbers of the cell, SI units. */", *lines, ""])


def _table(subject: Subject, variables: Sequence[Variable], parts: Parts, token: str) -> str:
    """The text of variables.c."""
    lines = ["#include <string.h>", "", f'#include "{subject}.h"', '#include "model.h"', ""]
    lines.append("const struct model_variable model_variables[] = {")
    for variable in variables:
        place = f"offsetof(struct model, {variable.member})"
        low, high = variable.bounds or (0.0, 0.0)
        row = (f'"{variable.name}"', place, _TYPES[variable.kind], _setting(variable), repr(low), repr(high))
        lines.append(f"    {{{', '.join(row)}}},")
    lines += [
        "};",
        f"const size_t model_count = {len(variables)};",
        "const size_t model_size = sizeof(struct model);",
    ]
    lines += [f'const char model_token[] = "{token}";', "", "void model_set_start_values(struct model *model)", "{"]
    for variable in variables:
        if isinstance(variable.start, str):
            lines.append(f'    strcpy(model->{variable.member}, "{variable.start}");')
        elif variable.start is not None:
            value = str(variable.start).lower() if isinstance(variable.start, bool) else repr(variable.start)
            lines.append(f"    model->{variable.member} = {value};")
    lines += [f"    model->{member} = {literal};" for member, literal in parts.start.items()]
    lines += ["}", "", "uint64_t model_events(const struct model *model)", "{", "    uint64_t bits = 0;"]
    for variable in variables:
        if variable.causality == "output" and variable.kind == "Boolean":
            lines.append(f"    bits = bits << 1 | (uint64_t)model->{variable.member};")
    return "\n".join([*lines, "    return bits;", "}", ""])


def _setting(variable: Variable) -> str:
    if variable.causality in ("independent", "output"):
        return "MODEL_NEVER"
    return "MODEL_BEFORE_START" if variable.variability == "fixed" else "MODEL_ALWAYS"
