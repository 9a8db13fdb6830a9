"""Random sequences of calls: what is allowed is done, what is not is refused, and no byte of others is touched."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from dtwin.fmu.description import COMPILER_OPTIONS
from dtwin.fmu.sources import Subject, Version
from tests.fmu.conftest import Made
from tests.support.fmi import Library
from tests.support.fmi_fuzz import fuzz
from tests.support.iec61499.c_harness import COMPILER, needs_compiler

pytestmark = [
    needs_compiler,
    pytest.mark.parametrize("version", ["3.0", "2.0"]),
    pytest.mark.parametrize("subject", ["twin", "controller", "cell"]),
]
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O1")
OF_EACH = 16_667
"""Sequences for each of the six FMUs, 100,000 in all."""


def test_random_calls(made: Made, subject: Subject, version: Version) -> None:
    fuzz(Library(made(subject, version)), seed=43, count=40)


@pytest.mark.thorough
def test_random_calls_under_sanitizers(made: Made, subject: Subject, version: Version, tmp_path: Path) -> None:
    """In a process of their own, which ends where memory or arithmetic is not as C says."""
    assert COMPILER is not None
    folder, binary = made(subject, version), tmp_path / "sanitized.so"
    sources = sorted(map(str, (folder / "sources").glob("*.c")))
    shared = ("-fPIC", "-shared", "-o", str(binary))
    options = (*COMPILER_OPTIONS.split(), *SANITIZERS)
    built = subprocess.run([*COMPILER.command, *options, *shared, *sources, "-lm"], capture_output=True, text=True)
    if built.returncode:
        pytest.skip(f"the compiler has no sanitizers: {built.stderr[-200:]}")
    library = subprocess.run([*COMPILER.command, "-print-file-name=libasan.so"], capture_output=True, text=True)
    preloaded = {"LD_PRELOAD": library.stdout.strip(), "ASAN_OPTIONS": "detect_leaks=0"}
    command = [sys.executable, "-m", "tests.support.fmi_fuzz", str(folder), str(binary), "43", str(OF_EACH)]
    done = subprocess.run(command, env=os.environ | preloaded, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"{OF_EACH} sequences\n"), done.stderr[-4000:]
