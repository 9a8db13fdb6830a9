"""Random programs do in Python, C and Lua what an oracle says that stands on the standard alone.

Every program has a seed of its own, which a failure names: `compared([SEED])` runs it again.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.st.check import check_algorithm
from iec61499.st.parser import parse_algorithm
from iec61499.st.typed import CheckedAlgorithm
from tests.support.iec61499.c_harness import COMPILER, run_c
from tests.support.iec61499.st_harness import LUA, run_lua, run_python
from tests.support.iec61499.st_oracle import Fault, equal, left_by
from tests.support.iec61499.st_oracle_functions import Unsaid
from tests.support.iec61499.st_random import Program, program

FEW = 90
MANY = 10_000
BATCH = 250
"""Programs of one C unit."""
Left = dict[str, Any] | None
"""What a program leaves in its variables; None when it ends with an error."""


def drawn(seed: int) -> Program:
    """The program of a seed: of three, two for Lua, too."""
    return program(seed, lua=seed % 3 > 0)


def expected(of: Program) -> Left:
    """What the oracle says. Raises Unsaid."""
    try:
        return left_by(parse_algorithm(of.text), of.types, of.values)
    except Fault:
        return None


def in_python(of: Program, checked: CheckedAlgorithm) -> Left:
    try:
        return run_python(checked, of.types, of.values)
    except FunctionBlockError:
        return None


def in_lua(of: Program, checked: CheckedAlgorithm, interpreter: str) -> Left:
    try:
        return run_lua(checked, of.types, of.values, interpreter)
    except LUA[interpreter].LuaError:
        return None


def in_c(programs: Sequence[Program], checked: Sequence[CheckedAlgorithm], folder: Path) -> list[Left]:
    cases = [(code, of.types, of.values) for code, of in zip(checked, programs, strict=True)]
    return [left if isinstance(left, dict) else None for left in run_c(cases, folder)]


def difference(of: Program, wanted: Left, got: Left) -> str:
    """What differs, "" when nothing does."""
    if wanted is None or got is None:
        return "" if wanted is got else f"an error is {'missing' if wanted is None else 'not expected'}"
    wrong = [name for name in of.types if not equal(wanted[name], got[name])]
    return "; ".join(f"{name} is {got[name]!r}, expected {wanted[name]!r}" for name in wrong)


def compared(seeds: Sequence[int], folder: Path | None = None) -> list[str]:
    """Runs the programs of the seeds; what differs from the oracle."""
    programs, codes, wanted, names = [], [], [], []
    for seed in seeds:
        made = drawn(seed)
        try:
            left = expected(made)
        except Unsaid:
            continue
        programs.append(made)
        codes.append(check_algorithm(parse_algorithm(made.text), made.types, made.types.keys()))
        wanted.append(left)
        names.append(seed)
    found = [
        ("Python", seed, in_python(*of)) for seed, of in zip(names, zip(programs, codes, strict=True), strict=True)
    ]
    for seed, made, code in zip(names, programs, codes, strict=True):
        if seed % 3:
            interpreter = list(LUA)[seed // 3 % len(LUA)]
            found.append((interpreter, seed, in_lua(made, code, interpreter)))
    if folder is not None:
        found += [("C", seed, left) for seed, left in zip(names, in_c(programs, codes, folder), strict=True)]
    lines = []
    for backend, seed, got in found:
        number = names.index(seed)
        text = difference(programs[number], wanted[number], got)
        if text:
            lines.append(f"seed {seed} in {backend}: {text}\n{programs[number].values}\n{programs[number].text}")
    assert len(programs) > 0.9 * len(seeds)
    return lines


def test_programs_do_what_the_oracle_says(tmp_path: Path) -> None:
    wrong = compared(range(FEW), tmp_path if COMPILER is not None else None)
    assert not wrong, "\n".join(wrong)


@pytest.mark.thorough
@pytest.mark.parametrize("first", range(0, MANY, BATCH))
def test_many_programs_do_what_the_oracle_says(first: int, tmp_path: Path) -> None:
    wrong = compared(range(first, first + BATCH), tmp_path if COMPILER is not None else None)
    assert not wrong, "\n".join(wrong)
