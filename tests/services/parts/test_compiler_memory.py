"""The memory that the compiler's code takes up, before and after it is given back."""

import re
from pathlib import Path

import pytest

from dtwin.services.parts.readiness import compiler_memory
from dtwin.services.parts.readiness.compiler_memory import release_compiler
from dtwin.twin.compiled import kernel

SMAPS = """\
10000-20000 r-xp 00000000 08:01 1 /venv/llvmlite/binding/libllvmlite.so
Rss:                  64 kB
Anonymous:             0 kB
20000-30000 r--p 00000000 08:01 1 /venv/llvmlite/binding/libllvmlite.so
Rss:                  64 kB
Anonymous:            64 kB
30000-40000 rw-p 00000000 08:01 1 /venv/llvmlite/binding/libllvmlite.so
Rss:                  64 kB
Anonymous:             0 kB
50000-60000 r-xp 00000000 08:01 1 /usr/lib/libc.so.6
Rss:                  64 kB
Anonymous:             0 kB
60000-70000 rw-p 00000000 00:00 0
Rss:                  64 kB
Anonymous:             0 kB
"""


@kernel
def add(a: float, b: float) -> float:
    """A kernel to be compiled."""
    return a + b


def resident() -> int:
    """Resident memory of this process, kB."""
    (found,) = re.findall(r"VmRSS:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return int(found)


@pytest.mark.skipif(not Path("/proc/self/smaps").exists(), reason="needs Linux's /proc/self/smaps")
def test_memory_of_the_compiler_is_given_back_and_it_still_compiles() -> None:
    assert add(1.0, 2.0) == 3.0
    before = resident()
    released = release_compiler()
    assert released > 20e6
    assert before - resident() > 0.9 * released / 1024
    assert add(1, 2) == 3  # another signature, which is compiled anew


def test_only_what_equals_the_compilers_file_is_given_back() -> None:
    assert list(compiler_memory._unchanged(SMAPS)) == [(0x10000, 0x20000, 65536)]


def test_without_linux_nothing_is_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiler_memory, "_SMAPS", Path("/nowhere/smaps"))
    assert release_compiler() == 0
