"""matiec, a compiler of IEC 61131-3 that shares nothing with this project, as one more backend for programs."""

from __future__ import annotations

import math
import os
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from iec61499.types import ArrayType, DataType, ElementaryType
from tests.support.iec61499.st_random import Program

MATIEC: Final = os.environ.get("MATIEC", "")
NO_MATIEC: Final = "set MATIEC to the folder of a matiec checkout in which iec2c is built, to run this"
_FLAGS: Final = ("-O0", "-w", "-ffp-contract=off", "-fno-strict-aliasing")
_MATH: Final = ("acos", "asin", "atan", "cos", "exp", "log", "log10", "sin", "sqrt", "tan")
_HEAD: Final = "\n".join(
    [
        "#include <math.h>",
        "#include <stdio.h>",
        "#include <string.h>",
        "#include <stdlib.h>",
        *(f"double iec_lib_{name}(double x) {{ return {name}(x); }}" for name in _MATH),
        "double iec_lib_fmod(double x, double y) { return fmod(x, y); }",
        "double iec_lib_pow(double x, double y) { return pow(x, y); }",
        "#define iec_lib_snprintf snprintf",
        '#include "POUS.h"',
        '#include "POUS.c"',
        "TIME __CURRENT_TIME;",
        "BOOL __DEBUG;",
        'static void text(STRING s) { for (int i = 0; i < s.len; i++) printf("%02x", s.body[i]); puts(""); }',
    ]
)


def declared(number: int, of: Program) -> str:
    """The program as a unit of its own."""
    lines = [f"PROGRAM P{number}", "VAR"]
    for name, kind in of.types.items():
        if isinstance(kind, ArrayType):
            lines.append(f"{name} : ARRAY [{kind.lower}..{kind.upper}] OF {kind.element};")
        else:
            lines.append(f"{name} : {kind};")
    return "\n".join([*lines, "END_VAR", of.text, "END_PROGRAM", ""])


def translate(source: str, folder: Path) -> str:
    """Lets matiec write C into a folder; what it complains of, "" for nothing."""
    folder.mkdir(exist_ok=True)
    file = folder / "programs.st"
    file.write_text(source)
    command = [f"{MATIEC}/iec2c", "-I", f"{MATIEC}/lib", "-T", str(folder), str(file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    return "" if done.returncode == 0 else (done.stderr or done.stdout or "refused").strip()


def run(programs: Sequence[Program], folder: Path) -> list[dict[str, Any]]:
    """What programs leave that matiec takes."""
    problem = translate("".join(declared(number, of) for number, of in enumerate(programs)), folder)
    assert not problem, problem
    calls = []
    for number, of in enumerate(programs):
        lines = [f"static void run{number}(void) {{ static P{number} d; P{number}_init__(&d, 0);"]
        lines += [line for name, value in of.values.items() for line in _put(name, of.types[name], value)]
        lines += [f"P{number}_body__(&d);", *(x for name, kind in of.types.items() for x in _get(name, kind)), "}"]
        calls.append("\n".join(lines))
    main = "".join(f"run{number}();" for number in range(len(programs)))
    (folder / "main.c").write_text("\n".join([_HEAD, *calls, f"int main(void) {{ {main} return 0; }}\n"]))
    binary = folder / "programs"
    include = ["-I", f"{MATIEC}/lib/C", "-I", str(folder)]
    subprocess.run(["cc", *_FLAGS, *include, str(folder / "main.c"), "-o", str(binary), "-lm"], check=True)
    printed = iter(
        subprocess.run([binary], capture_output=True, text=True, check=True, timeout=60).stdout.split("\n")
    )
    return [{name: _taken(kind, printed) for name, kind in of.types.items()} for of in programs]


def _c_name(name: str) -> str:
    return f"d.{name}.value"


def _put(name: str, kind: DataType, value: Any) -> list[str]:
    if isinstance(kind, ArrayType):
        return [f"{_c_name(name)}.table[{k}] = {_literal(kind.element, item)};" for k, item in enumerate(value)]
    assert isinstance(kind, ElementaryType)
    if kind.kind == "string":
        return [f'{_c_name(name)} = (STRING){{{len(value)}, "{value}"}};']
    return [f"{_c_name(name)} = {_literal(kind, value)};"]


def _literal(kind: DataType, value: Any) -> str:
    if isinstance(value, float):
        return str(value).upper().replace("INF", "INFINITY") if not math.isfinite(value) else value.hex()
    return f"({kind}){int(value) % 2**64}ULL"


def _get(name: str, kind: DataType) -> list[str]:
    if isinstance(kind, ArrayType):
        return [_print(kind.element, f"{_c_name(name)}.table[{k}]") for k in range(kind.length)]
    return [_print(kind, _c_name(name))]


def _print(kind: DataType, place: str) -> str:
    assert isinstance(kind, ElementaryType)
    if kind.kind == "string":
        return f"text({place});"
    if kind.kind == "real":
        return f'printf("%a\\n", (double){place});'
    sign = "lld" if kind.kind == "signed" else "llu"
    return f'printf("%{sign}\\n", (long {"long" if kind.kind == "signed" else "unsigned long"}){place});'


def _taken(kind: DataType, lines: Any) -> Any:
    if isinstance(kind, ArrayType):
        return [_taken(kind.element, lines) for _ in range(kind.length)]
    assert isinstance(kind, ElementaryType)
    text = next(lines)
    if kind.kind == "string":
        return bytes.fromhex(text).decode()
    if kind.kind == "real":
        return float("nan") if "nan" in text else float("inf") if text == "inf" else _real(text)
    return bool(int(text)) if kind.kind == "bool" else int(text)


def _real(text: str) -> float:
    return -math.inf if text == "-inf" else float.fromhex(re.sub(r"\s", "", text))
