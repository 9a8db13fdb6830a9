"""Runs algorithms as machine code."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from iec61499.native import memory
from iec61499.native.build import FLAGS, compile_unit, compilers
from iec61499.native.heads import structures
from iec61499.native.unit import Unit
from iec61499.st.c.expressions import Places
from iec61499.st.c.names import c_name, declaration, size_of
from iec61499.st.c.translate import c_function
from iec61499.st.semantics import ITERATION_LIMIT
from iec61499.st.typed import CheckedAlgorithm
from iec61499.types import DataType, Member, StructType

COMPILER = next(compilers(), None)
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler, neither cc nor the package ziglang")

HEADER = """
#include "fb.h"
size_t size_of_run(void);
void prepare(struct fb_run *run);
"""
SOURCE = """
#include "algorithms.h"
size_t size_of_run(void) { return sizeof(struct fb_run); }
void prepare(struct fb_run *run) { memset(run, 0, sizeof *run); run->iterations = %d; }
"""
Program = tuple[CheckedAlgorithm, Mapping[str, DataType], Mapping[str, Any]]
"""An algorithm, the variables of its block, and their values before it runs."""


def run_c(programs: Sequence[Program], folder: Path, flags: tuple[str, ...] = ()) -> list[dict[str, Any] | int]:
    """What the algorithms leave in their variables, or the number of the fault that one finds."""
    assert COMPILER is not None
    header, source, places = [HEADER], [SOURCE % ITERATION_LIMIT], Places()
    header += [f"{line}\n" for line in structures(kind for _, scope, _ in programs for kind in scope.values())]
    for number, (checked, scope, _) in enumerate(programs):
        members = "".join(f"    {declaration(c_name(name), kind)};\n" for name, kind in scope.items())
        signature = f"void algorithm{number}(struct block{number} *self, struct fb_run *run)"
        header.append(f"struct block{number} {{\n{members}}};\n{signature};\n")
        source.append("\n".join(c_function(checked, signature, places).lines) + "\n")
    unit = Unit("".join(header), "".join(source))
    library = ctypes.CDLL(str(compile_unit(unit, "algorithms", COMPILER, folder, (*FLAGS, "-O0", *flags))))
    library.size_of_run.restype = ctypes.c_size_t
    run = ctypes.create_string_buffer(library.size_of_run())
    results: list[dict[str, Any] | int] = []
    for number, (_, scope, values) in enumerate(programs):
        block = StructType("block", tuple(Member(name, kind, kind.default) for name, kind in scope.items()))
        buffer = ctypes.create_string_buffer(size_of(block))
        memory.write(buffer, 0, block, [values.get(name, kind.default) for name, kind in scope.items()])
        library.prepare(run)
        getattr(library, f"algorithm{number}")(buffer, run)
        problem = int.from_bytes(run.raw[:4], "little")
        results.append(problem or dict(zip(scope, memory.read(buffer, 0, block), strict=True)))
    return results
