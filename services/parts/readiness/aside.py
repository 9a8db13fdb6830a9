"""Preparation in a process of its own, for a service that only waits until somebody wants its work."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Final

from dtwin.services.supervisor import PREPARED

if TYPE_CHECKING:
    from dtwin.services.service import Service

log = logging.getLogger(__name__)

_WORDS: Final = 300
"""Number of characters of its last words that are told."""


def prepare_aside(service: Service, name: str, module: str) -> None:
    """Runs a module that goes through the work once, and tells how far it is, until the service is asked to end.

    What it compiles stays on disk for the service, and its memory goes with it. Where it fails the service goes on,
    and compiles when somebody wants its work. A service that starts again has what an earlier one compiled.

    Args:
        service: the service, which is not ready yet.
        name: what is prepared, in words.
        module: name of the module, which prints a line for every kernel that it begins to compile.
    """
    if os.environ.get(PREPARED):
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
    if process.returncode and not service.stopping:
        last = compiled[-1].strip()[-_WORDS:] if compiled else "it said nothing"
        log.warning("%s could not be prepared, so that the first use takes longer: %s", name, last)
