"""Preparation in a process of its own, for a service that only waits until somebody wants its work."""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import subprocess
import sys
import threading
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Final

from dtwin.parameters import SOURCE
from dtwin.services.supervisor import PREPARED
from iec61499.runtime.kept.folder import kept_folder

if TYPE_CHECKING:
    from dtwin.services.service import Service

log = logging.getLogger(__name__)

_WORDS: Final = 300
"""Number of characters of its last words that are told."""


def prepare_aside(service: Service, name: str, module: str) -> None:
    """Runs a module that goes through the work once, and tells how far it is, until the service is asked to end.

    What it compiles stays on disk for the service, and its memory goes with it. Where it fails the service goes on,
    and compiles when somebody wants its work. A service that starts again has what an earlier one compiled, and so
    has one after a process that has prepared for the same code.

    Args:
        service: the service, which is not ready yet.
        name: what is prepared, in words.
        module: name of the module, which prints a line for every kernel that it begins to compile.
    """
    if os.environ.get(PREPARED):
        return
    note, code = _note_of(module), _code_of(module)
    if note is not None and _read(note) == code:
        return
    compiled: list[str] = []
    command = [sys.executable, "-m", module]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        reader = threading.Thread(target=compiled.extend, args=(process.stdout,), daemon=True)
        reader.start()
        while process.poll() is None and not service.stopping:
            service.doing = f"prepares {name}; kernels compiled: {len(compiled)}"
            service.pause()
        process.terminate()
        reader.join()
    service.doing = ""
    if note is not None and process.returncode == 0:
        with suppress(OSError):  # where nothing can be written, every service prepares
            note.write_text(code)
    if process.returncode and not service.stopping:
        last = compiled[-1].strip()[-_WORDS:] if compiled else "it said nothing"
        log.warning("%s could not be prepared, so that the first use takes longer: %s", name, last)


def _note_of(module: str) -> Path | None:
    """The file, beside the compiled module, that tells for which code it has prepared; None if there is no module."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return None
    return Path(spec.origin).parent / "__pycache__" / f"{module}.prepared"


def _read(note: Path) -> str:
    with suppress(OSError, UnicodeDecodeError):
        return note.read_text()
    return ""


def _code_of(module: str) -> str:
    """A checksum of what kept kernels depend on: sources, Numba, Python, the machine, and where they are kept."""
    specs = (find_spec(name) for name in (module, "numba"))
    origins = [Path(spec.origin) for spec in specs if spec is not None and spec.origin is not None]
    parts = [sys.version, platform.node(), os.environ.get("NUMBA_CACHE_DIR") or str(kept_folder())]
    for source in (*origins, *sorted((SOURCE / "dtwin").rglob("*.py"))):
        with suppress(OSError):  # a file that goes meanwhile
            status = source.stat()
            parts.append(f"{source} {status.st_mtime_ns} {status.st_size}")
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
