"""Gives back the memory that the compiler's own code takes up once all kernels are loaded.

Loading a kernel runs LLVM, whose code then stays in the memory of the process, 70 MB of it, and is not run again.
Linux reads a page of a program's file anew when it is needed after all, so that nothing is lost but a little time.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

_SMAPS: Final = Path("/proc/self/smaps")
_HEADER: Final = re.compile(r"([0-9a-f]+)-([0-9a-f]+) (\S+) \S+ \S+ \S+ *(.*)")
_COMPILER: Final = "libllvmlite"
_DONTNEED: Final = 4
"""MADV_DONTNEED of madvise(2)."""


def release_compiler() -> int:
    """Gives back the pages of LLVM's code and constants; returns their size, bytes, 0 where there are none to give.

    Only what equals the file is given back: a mapping that may be written, or of which a page differs from the file,
    stays as it is.
    """
    if not _SMAPS.exists():
        return 0
    madvise = ctypes.CDLL(None, use_errno=True).madvise
    madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    released = 0
    for start, end, resident in _unchanged(_SMAPS.read_text()):
        if madvise(start, end - start, _DONTNEED) == 0:
            released += resident
    return released


def _unchanged(smaps: str) -> Iterator[tuple[int, int, int]]:
    """First address, end and resident size in bytes of each mapping of the compiler that equals its file."""
    mapping: tuple[int, int] | None = None
    resident = 0
    for line in smaps.splitlines():
        if header := _HEADER.fullmatch(line):
            start, end, rights, path = header.groups()
            of_compiler = _COMPILER in Path(path).name and "w" not in rights
            mapping = (int(start, 16), int(end, 16)) if of_compiler else None
        elif mapping is not None and line.startswith("Rss:"):
            resident = int(line.split()[1]) * 1024
        elif mapping is not None and line.startswith("Anonymous:") and line.split()[1] == "0":
            yield (*mapping, resident)
