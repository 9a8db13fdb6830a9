"""Compiles C units once, and keeps the machine code for every process that comes after.

The compiler is the system's `cc`, or the one of the package `ziglang` (`pip install dtwin[native]`). Files are kept
in `dtwin/native` of the user's cache folder, in DTWIN_CACHE_DIR, or, of a user who has no folder, among the temporary
files. The folder must be the user's own with mode 0700 (see `kept`), and each file ends with a checksum over it and
its key: what is damaged or was made from something else is made again. When they become many, the oldest go.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import logging
import os
import platform
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Final

from iec61499 import model
from iec61499.errors import NativeError
from iec61499.library import Library
from iec61499.native.layout import Layout, network_layout
from iec61499.native.unit import Unit, unit_of
from iec61499.runtime.kept.folder import MAKING, kept_folder, tidy, used

log = logging.getLogger(__name__)

HEADER: Final = Path(__file__).parents[1] / "st" / "c" / "fb.h"
"""What every unit includes."""
_OWN_BITS: Final = ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "log10", "pow")
NAME: Final = "unit"
"""Begins the names that the machine code of a network has for others."""
FLAGS: Final = (
    *("-std=c99", "-O1", "-fPIC", "-shared", "-ffp-contract=off", "-fno-fast-math", "-fno-math-errno"),
    # the compiler would round better than libm where an argument is a constant
    *(f"-fno-builtin-{function}" for function in _OWN_BITS),
)
_CHECKSUM: Final = hashlib.sha256().digest_size
_LONGEST: Final = 120.0
"""Longest time that a compiler may take, s."""
_FOLDERS: Final = ("../st", "../runtime", "../standard", "../trace", ".")
"""Folders of the sources that decide what is generated."""


@dataclass(frozen=True, slots=True)
class Compiler:
    """A C compiler: the command that runs it, and what tells it from others."""

    command: tuple[str, ...]
    identity: str


def compilers() -> Iterator[Compiler]:
    """The compilers that are here, the one to try first first."""
    for name in ("cc", "gcc", "clang"):
        path = shutil.which(name)
        if path is not None:
            found = Path(path).resolve()
            status = found.stat()
            yield Compiler((path,), f"{found}|{status.st_size}|{status.st_mtime_ns}")
            break
    package = importlib.util.find_spec("ziglang")
    if package is not None and package.origin is not None:
        status = Path(package.origin).stat()
        identity = f"{package.origin}|{status.st_mtime_ns}"
        yield Compiler((sys.executable, "-m", "ziglang", "cc"), identity)


def load(
    subject: str, name: str, make: Callable[[], Mapping[str, str]], flags: tuple[str, ...] = FLAGS
) -> ctypes.CDLL:
    """The machine code of a unit.

    Args:
        subject: what the unit is made from, all of it; equal texts have equal units.
        name: the unit's name.
        make: makes the texts of its C files, by their names, when its machine code is not kept.
        flags: how it is compiled.

    Raises:
        NativeError: there is no compiler, or its result cannot be used.
        FunctionBlockError: the unit cannot be made.
    """
    if os.name != "posix":
        raise NativeError("machine code: expected a POSIX system")
    texts: Mapping[str, str] = {}
    problems = []
    for compiler in compilers():
        key = _key(subject, compiler, flags)
        folder = kept_folder()
        kept = folder / f"{name}-{key}.so" if folder is not None else None
        if kept is not None and _is_intact(kept, key):
            try:
                library = ctypes.CDLL(str(kept))
                used(kept)
                return library
            except OSError as error:
                log.info("%s: made again: %s", kept, error)
        texts = texts or make()
        try:
            with _workshop(folder) as place:
                made = compile_files(texts, f"{name}.so", compiler, place, flags)
                made.write_bytes(_sealed(made.read_bytes(), key))
                library = ctypes.CDLL(str(made))
                if kept is not None:
                    made.replace(kept)
                    tidy(kept.parent, kept)
                return library
        except (NativeError, OSError) as error:
            problems.append(str(error))
    raise NativeError(
        f"machine code: {'; '.join(problems) or 'there is no C compiler'}: expected a C compiler as `cc`, or the "
        "package ziglang (pip install dtwin[native])"
    )


def compiled(texts: Mapping[str, str], target: str, compiler: Compiler, flags: tuple[str, ...]) -> bytes:
    """The library that a compiler makes of C files, for programs of others: kept, or made now.

    Args:
        texts: the files, by their names.
        target: name of the library.
        compiler: which one.
        flags: how it is compiled.

    Raises:
        NativeError: the compiler cannot be run, or refuses the files.
    """
    key = _key(repr((target, sorted(texts.items()))), compiler, flags)
    folder = kept_folder()
    kept = folder / f"{Path(target).stem}-{key}.so" if folder is not None else None
    if kept is not None and _is_intact(kept, key):
        used(kept)
        return kept.read_bytes()[:-_CHECKSUM]
    with _workshop(folder) as place:
        made = compile_files(texts, target, compiler, place, flags)
        content = made.read_bytes()
        if kept is not None:
            made.write_bytes(_sealed(content, key))
            made.replace(kept)
            tidy(kept.parent, kept)
    return content


def _key(subject: str, compiler: Compiler, flags: tuple[str, ...]) -> str:
    digest = _sources().copy()
    for part in (platform.machine(), compiler.identity, *flags, subject):
        digest.update(part.encode("utf-8", "surrogateescape") + b"\0")
    return digest.hexdigest()


@cache
def _sources() -> hashlib._Hash:
    """The begun hash of what makes units."""
    digest = hashlib.sha256()
    for folder in _FOLDERS:
        for path in sorted((Path(__file__).parent / folder).glob("**/*")):
            if path.suffix in (".py", ".h", ".lark"):
                digest.update(path.read_bytes())
    return digest


def _is_intact(path: Path, key: str) -> bool:
    """Whether a kept file is this user's and as it was made for the key."""
    try:
        status = path.lstat()
        if not stat.S_ISREG(status.st_mode) or status.st_uid != os.geteuid():
            return False
        content = path.read_bytes()
    except OSError:
        return False
    if len(content) > _CHECKSUM and _sealed(content[:-_CHECKSUM], key) == content:
        return True
    log.info("%s: damaged, made again", path)
    return False


def _sealed(content: bytes, key: str) -> bytes:
    """The content and a checksum over it and the key; what stands behind the end of a library is not looked at."""
    return content + hashlib.sha256(key.encode() + content).digest()


@contextmanager
def _workshop(folder: Path | None) -> Iterator[Path]:
    """A folder of this process, on the disk of the kept files, so that a file moves at once."""
    with tempfile.TemporaryDirectory(prefix=MAKING, dir=folder) as place:
        yield Path(place)


def compile_unit(unit: Unit, name: str, compiler: Compiler, folder: Path, flags: tuple[str, ...] = FLAGS) -> Path:
    """Compiles a unit in a folder and returns the path of the result. Raises NativeError."""
    return compile_files(unit_files(unit, name), f"{name}.so", compiler, folder, flags)


def compile_files(
    texts: Mapping[str, str], target: str, compiler: Compiler, folder: Path, flags: tuple[str, ...] = FLAGS
) -> Path:
    """Compiles C files, given by their names, in a folder to a library there and returns its path.

    Raises:
        NativeError: the compiler cannot be run, or refuses the files.
    """
    for file, text in texts.items():
        (folder / file).write_text(text)
    made = folder / target
    sources = [str(folder / file) for file in sorted(texts) if file.endswith(".c")]
    command = [*compiler.command, *flags, "-o", str(made), *sources, "-lm"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=_LONGEST)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NativeError(f"{compiler.command[0]}: {error}") from None
    if done.returncode or not made.is_file():
        first = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr[:200].strip())
        raise NativeError(f"{compiler.command[0]} failed: {first}")
    return made


def unit_files(unit: Unit, name: str) -> dict[str, str]:
    """The files fb.h, NAME.h and NAME.c that make up a unit."""
    return {HEADER.name: HEADER.read_text(), f"{name}.h": unit.header, f"{name}.c": unit.source}


class _Same:
    """Something that is equal to itself alone."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)


def machine_code(
    network: model.FBNetwork, library: Library, traced: bool, hosted: bool
) -> tuple[Layout, ctypes.CDLL]:
    """Layout and machine code of a network; those of one that was asked for lately are there at once.

    Args:
        network: what runs.
        library: finds the block types that the network uses.
        traced: whether it can record its events.
        hosted: whether a host does what other services than restart and timers do.

    Raises:
        FunctionBlockError: the network or one of its types is wrong, or needs what C cannot do.
        NativeError: machine code cannot be made here.
    """
    return _machine_code(_Same(network), _Same(library), traced, hosted)


@lru_cache(maxsize=8)
def _machine_code(network: _Same, library: _Same, traced: bool, hosted: bool) -> tuple[Layout, ctypes.CDLL]:
    layout = network_layout(network.value, library.value)
    subject = f"{layout.netlist!r}{' traced' * traced}{' hosted' * hosted}"
    return layout, load(subject, NAME, lambda: unit_files(unit_of(layout, NAME, traced, hosted), NAME))
