"""The C sources of the models: hand-written ones of the folder `c`, and those that follow from the variables."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
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
_PARTS: Final[dict[Subject, tuple[str, ...]]] = {
    "twin": ("arm",),
    "controller": ("control",),
    "cell": ("arm", "control"),
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


def source_files(
    subject: Subject, version: Version, variables: Sequence[Variable], layout: Layout | None
) -> dict[str, str]:
    """The texts of all C files of a model, by name.

    Args:
        subject: the model.
        version: version of FMI.
        variables: its variables.
        layout: the layout of the function blocks, if it has some.
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
        f"{subject}.h",
        f"{subject}.c",
    ]
    for part in _PARTS[subject]:
        names += [f"{part}.h", f"{part}.c"]
    if "arm" in _PARTS[subject]:
        names.append("equations.h")
    texts = {name: (_FOLDER / name).read_text() for name in names}
    if layout is not None:
        texts |= unit_files(unit_of(layout, PROGRAM), PROGRAM)
    texts["constants.h"] = _constants()
    return texts | {"variables.c": _table(subject, variables, token_of(variables, texts))}


def token_of(variables: Sequence[Variable], texts: dict[str, str]) -> str:
    """What tells a model from others: equal sources and variables have equal tokens."""
    digest = hashlib.sha256(repr(variables).encode())
    for name, text in sorted(texts.items()):
        digest.update(f"{name}\0{text}\0".encode())
    hexadecimal = digest.hexdigest()
    parts = (hexadecimal[0:8], hexadecimal[8:12], hexadecimal[12:16], hexadecimal[16:20], hexadecimal[20:32])
    return f"{{{'-'.join(parts)}}}"


def _constants() -> str:
    values = {
        "GRAVITY": GRAVITY,
        "VOLTAGE_LIMIT": VOLTAGE_LIMIT,
        "PERIOD": PERIOD,
        "CLOCK_ROUNDING": _CLOCK_ROUNDING,
        "TIME_ROUNDING": _TIME_ROUNDING,
        "LONGEST_DURATION": LONGEST_DURATION,
        "FARTHEST_TIME": FARTHEST_TIME,
    }
    lines = [f"#define {name} {value!r}" for name, value in values.items()]
    return "\n".join(["/* Numbers of the cell, SI units. */", *lines, ""])


def _table(subject: Subject, variables: Sequence[Variable], token: str) -> str:
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
    lines += ["}", "", "uint64_t model_events(const struct model *model)", "{", "    uint64_t bits = 0;"]
    for variable in variables:
        if variable.causality == "output" and variable.kind == "Boolean":
            lines.append(f"    bits = bits << 1 | (uint64_t)model->{variable.member};")
    return "\n".join([*lines, "    return bits;", "}", ""])


def _setting(variable: Variable) -> str:
    if variable.causality in ("independent", "output"):
        return "MODEL_NEVER"
    return "MODEL_BEFORE_START" if variable.variability == "fixed" else "MODEL_ALWAYS"
