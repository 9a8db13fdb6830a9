"""A task at the worker of a cluster, which may have other versions than the sender, and several threads."""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import platform
import threading
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Final, TypeVar

import dtwin
from dtwin.campaign.task import Failure, Success, attempt
from dtwin.controller.runtime import Runtime, chosen

T = TypeVar("T")
R = TypeVar("R")

_LIBRARIES: Final = ("mujoco", "numba", "numpy", "scipy")
_SOURCES: Final = (".py", ".c", ".h", ".lark", ".fbt", ".sys", ".xml", ".toml")
_turn: Final = threading.RLock()


@cache
def versions() -> Mapping[str, str]:
    """What decides the bits of a result, by name; of this package the digest of all that it computes with."""
    digest = hashlib.sha256()
    package = Path(dtwin.__file__).parent
    folders = sorted(os.walk(package, followlinks=True))
    for path in (Path(folder, file) for folder, _, files in folders for file in sorted(files)):
        if path.suffix in _SOURCES:
            digest.update(str(path.relative_to(package)).encode() + b"\0" + path.read_bytes())
    return {
        "dtwin": f"{dtwin.__version__} ({digest.hexdigest()[:12]})",
        "Python": ".".join(platform.python_version_tuple()[:2]),
        "the C library": " ".join(platform.libc_ver()),
        "the processor": platform.machine(),
        **{name: importlib.metadata.version(name) for name in _LIBRARIES},
    }


def attempt_there(
    function: Callable[[T], R], runtime: Runtime | None, wanted: Mapping[str, str], item: T
) -> Success[R] | Failure:
    """Does a task that was sent to this process.

    Args:
        function: what is done with the item.
        runtime: what runs function blocks at the sender.
        wanted: the sender's versions; with others the task fails, as its result might differ.
        item: the item.
    """
    for name, version in versions().items():
        if version != wanted.get(name):
            return Failure(f"{name} is {version} at the worker, expected {wanted.get(name)} as here")
    # A process can have one runtime at a time, and models that threads cannot share.
    with _turn, chosen(runtime):
        return attempt(function, item)
