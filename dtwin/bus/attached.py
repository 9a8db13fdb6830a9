"""Keeps the threads of Zenoh attached to Python.

Python forgets a foreign thread at the end of each call that comes from it, and sets it up anew at the next one: its
state, and memory for its frames that the system maps and unmaps. A thread that calls a hundred times a second spends
more on that than on small messages.
"""

from __future__ import annotations

import ctypes
import threading
from typing import Final

_known: Final = threading.local()


def stay_attached() -> None:
    """Lets the calling thread keep its state until it ends; cheap to call again.

    The state is counted (PyGILState_Ensure of Python's C interface): with one more entry than exits it stays.
    """
    if not hasattr(_known, "attached"):
        _known.attached = True
        ctypes.pythonapi.PyGILState_Ensure()
