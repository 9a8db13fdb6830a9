"""A disk without room, made by the system's limit on the size of files: a write beyond it fails like a full disk."""

import resource
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def full_disk(room: int, process: int = 0) -> Iterator[None]:
    """Lets no file of a process, this one by default, grow beyond `room` bytes meanwhile."""
    before = resource.prlimit(process, resource.RLIMIT_FSIZE)
    resource.prlimit(process, resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        yield
    finally:
        resource.prlimit(process, resource.RLIMIT_FSIZE, before)
