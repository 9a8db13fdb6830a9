"""What a service does before it is ready: it goes through its whole work once, so that all that is compiled is there.

Who is ready answers at once from then on, also in what is needed seldom, such as the diagnosis of a first fault.
Several services that want the same kernel wait for one another, see `dtwin.twin.compiled`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Final

from dtwin.services.parts.readiness.compiler_memory import release_compiler
from dtwin.services.supervisor import AGAIN, PREPARED

if TYPE_CHECKING:
    from dtwin.services.service import Service

_COMPILED: Final = "dtwin.twin.compiled"
Part = tuple[str, Callable[[], object]]
"""A part of the work: its name, and a function that does it once."""


def prepare(service: Service, parts: Sequence[Part]) -> None:
    """Does every part of the work once and tells how far that is, until the service is asked to end.

    The memory of the compiler is given back at the end. That of one that had to compile cannot be, 250 MB for the
    monitor: a service that is supervised ends then, and its supervisor starts it again, which finds all compiled.

    Args:
        service: the service, which is not ready yet.
        parts: the parts in the order in which they are done.

    Raises:
        SystemExit: the service shall be started again.
    """
    compiled = 0
    now = ""

    def tell() -> None:
        service.doing = f"{now}; kernels compiled: {compiled}"
        if service.report_due():
            service.report("starting")

    def count(kernel: str) -> None:
        nonlocal compiled
        compiled += 1
        tell()

    with service.interruptible(), _compilations(count):
        for number, (name, act) in enumerate(parts, 1):
            now = f"prepares {name}, {number} of {len(parts)}"
            tell()
            act()
    if compiled and service.supervised and PREPARED not in os.environ:
        sys.exit(AGAIN)
    release_compiler()
    service.doing = ""


def _compilations(tell: Callable[[str], object]) -> AbstractContextManager[None]:
    """Tells what is compiled meanwhile: nothing by a service without kernels, for which Numba is not loaded."""
    if _COMPILED not in sys.modules:
        return nullcontext()
    from dtwin.twin.compiled import compilations

    return compilations(tell)
