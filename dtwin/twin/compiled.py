"""Compiles kernels to machine code, and keeps the code on disk for every process that comes after.

The files are in the user's folder of machine code, where `iec61499.runtime.kept.folder` says, or in that which
NUMBA_CACHE_DIR names. Their names tell by a checksum what the code was made of: sources, constants, the fields of
structures, versions. So every checkout with the same sources finds it, and none finds that of other ones. Numba
trusts what it finds there: half a file would end every process that reads it, and other machine code would crash it.
So each file carries its checksum here, and a damaged one counts as none: the kernel is compiled again and the file
replaced. Where nothing can be written, every process compiles.

Of processes that want the same kernel at the same time one compiles and the others wait for its files: the lock of
the file `.lock` beside them ends with the process that holds it. Without it two that keep two forms of a kernel at
once would give their files the same name, and the index of the one would name the code of the other.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Final, TypeGuard

import llvmlite
import numba
import numpy as np
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.registry import CPUDispatcher, cpu_target

from iec61499.runtime.kept.folder import kept_folder, tidy, used

log = logging.getLogger(__name__)

_CHECKSUM: Final = hashlib.sha256().digest_size
_LONGEST: Final = 600.0
"""Longest time for which a process waits for one that may have been stopped, s; then it compiles as well. The kernels
of the monitor take 100 s of a processor together, and several times that where many processes share it: all that
gave up waiting would make it slower still."""
_LOOK: Final = 0.02
"""Time between two looks whether the other one is done, s."""
_COMPILE: Final = "numba:compile"
"""What Numba calls it when machine code is made."""
BLAS: Final = "scipy.linalg.cython_blas"
"""Module in which Numba finds the functions for products of matrices."""


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    nogil: bool = False,
    uses: tuple[ModuleType, ...] = (),
    inlined: bool = False,
) -> Any:
    """Decorates a function that Numba compiles at its first call, or loads compiled.

    With nogil other threads run meanwhile, which costs a short call too much. `uses` are modules of which it calls
    kernels: it is compiled again for other sources of these, or of those that their kernels use, which Numba by
    itself does not notice. What is `inlined` becomes a part of each kernel that calls it: a call costs more than the
    few operations of a small one. It is kept nowhere else, so that no kernel can be given what it was before its
    module, or one that it calls, was changed.
    """
    if function is None:
        return partial(kernel, nogil=nogil, uses=uses, inlined=inlined)
    dispatcher = numba.njit(error_model="numpy", nogil=nogil, forceinline=inlined)(function)
    if inlined:
        return dispatcher
    try:
        dispatcher._cache = _Cache(function, uses)
    except RuntimeError as error:  # no folder can be written
        log.info("%s", error)
    return dispatcher


def ready_compiler() -> None:
    """Has Numba load what it knows of types and functions, which it does else for the first kernel that is loaded."""
    cpu_target.typing_context.refresh()
    cpu_target.target_context.refresh()


@contextmanager
def compilations(tell: Callable[[str], object]) -> Iterator[None]:
    """Tells the name of each kernel that is compiled meanwhile, when that begins; of one that is loaded nothing."""
    with event.install_listener(_COMPILE, _Listener(tell)):
        yield


class _Listener(event.Listener):
    """Passes on what begins to be compiled."""

    def __init__(self, tell: Callable[[str], object]) -> None:
        self._tell = tell

    def on_start(self, event: event.Event) -> None:
        self._tell(event.data["dispatcher"].py_func.__name__)

    def on_end(self, event: event.Event) -> None:
        """What is done is of no interest."""


def _load_blas() -> None:
    """Loads the one module of SciPy that Numba needs, without the package around it, which takes as long as Numba.

    Whoever imports the package later finds the module in it. Where SciPy has no such file Numba imports the package.
    """
    package = find_spec("scipy")
    if BLAS in sys.modules or package is None:
        return
    folders = [str(Path(folder) / "linalg") for folder in package.submodule_search_locations or ()]
    spec = PathFinder.find_spec(BLAS, folders)
    if spec is not None and spec.loader is not None:
        module = module_from_spec(spec)
        sys.modules[BLAS] = module
        spec.loader.exec_module(module)


_load_blas()


class _Locator(_CacheLocator):
    """The folder of the files of all kernels."""

    def __init__(self, folder: str) -> None:
        self._folder = folder

    def get_cache_path(self) -> str:
        return self._folder

    def get_source_stamp(self) -> None:
        """Nothing: the names of the files tell what they were made of."""

    def get_disambiguator(self) -> str:
        return ""

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _Locator | None:
        """None if no folder can be written, which Numba makes a RuntimeError of."""
        folder = numba.config.CACHE_DIR or kept_folder()
        return None if folder is None else cls(str(folder))


class _Kept(CompileResultCacheImpl):
    """How code is written, with our folder."""

    _locator_classes = (_Locator,)


class _Cache(FunctionCache):
    """The compiled forms of one kernel, in checked files.

    Attributes:
        modules: those of which it calls kernels, and those of which these call some.
    """

    _impl_class = _Kept

    def __init__(self, function: Callable[..., Any], uses: tuple[ModuleType, ...]) -> None:
        super().__init__(function)
        own = sys.modules[function.__module__]
        self.modules = _called([*uses, own])
        name = f"{function.__module__}.{function.__qualname__}".replace("<", "").replace(">", "")
        base = f"{name}-{_checksum(own, self.modules)}"
        self._cache_file = _CheckedFile(self._cache_path, base, None)
        self._lock = _Lock(Path(self._cache_path) / f"{name}.lock")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What is kept, or None: then the lock is held, and the caller compiles and saves.

        Numba holds a lock of its own from here to `save_overload`, so that no two threads do this at once; kernels
        are locked in the order in which they call each other, which has no circles.
        """
        found = super().load_overload(sig, target_context)
        if found is None:
            self._lock.acquire()
            found = super().load_overload(sig, target_context)
            if found is not None:
                self._lock.release()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
            self._cache_file.tidy()
        except OSError as error:
            log.info("compiled code of %s is not kept: %s", self._name, error)
        finally:
            self._lock.release()


def _called(modules: Iterable[ModuleType]) -> dict[ModuleType, None]:
    """Some modules, and those whose kernels or structures they name, and what these need."""
    found: dict[ModuleType, None] = {}
    left = list(modules)
    while left:
        module = left.pop()
        if module not in found:
            found[module] = None
            for value in vars(module).values():
                if isinstance(value, CPUDispatcher):
                    left.append(sys.modules[value.py_func.__module__])
                    left += value._cache.modules if isinstance(value._cache, _Cache) else ()
                elif _is_structure(value):
                    left.append(sys.modules[value.__module__])
    return found


def _is_structure(value: object) -> TypeGuard[type[Any]]:
    """Whether a value is a class of named tuples."""
    return isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields")


def _checksum(own: ModuleType, modules: Iterable[ModuleType]) -> str:
    """Of what the code of a kernel is made of.

    Args:
        own: its module, which is being imported: what is defined there later on is in its source.
        modules: those of which it calls kernels.
    """
    parts = [numba.__version__, llvmlite.__version__, sys.version, *_told(own)]
    for module in modules:
        parts += _told(module) if module is own else _told_once(module)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@cache
def _told_once(module: ModuleType) -> list[str]:
    return _told(module)


def _told(module: ModuleType) -> list[str]:
    """Checksum of the source of a module, its constants, and the fields of its structures; raises RuntimeError where
    there is no source. Machine code has the constants of other modules in it, and the places of fields."""
    file: str | None = getattr(module, "__file__", None)
    if file is None:
        raise RuntimeError(f"compiled kernels of {module.__name__} are not kept: it has no source")
    source = hashlib.sha256(Path(file).read_bytes()).hexdigest()
    values = [f"{name} {_value(value)}" for name, value in vars(module).items() if not name.startswith("__")]
    return [module.__name__, source, *values]


def _value(value: object) -> str:
    """A constant in words that are the same in every process; nothing of what machine code cannot have in it."""
    if isinstance(value, bool | int | float | complex | str | np.generic):
        return repr(value)
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple):
        return f"({', '.join(map(_value, value))})"
    if _is_structure(value):
        return repr(value._fields)
    return ""


class _Lock:
    """The right of one process to compile a kernel.

    A kernel that cannot be compiled stays locked until the process calls it as it should or ends; others wait once.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None

    def acquire(self) -> None:
        """Waits for the lock, but not for long; the caller may go on without it, and does what another does, too."""
        if self._file is not None:
            return
        deadline = time.monotonic() + _LONGEST
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o644)
            while not _locked(self._file) and time.monotonic() < deadline:
                time.sleep(_LOOK)
        except OSError as error:
            log.info("%s: %s", self._path, error)

    def release(self) -> None:
        """Lets others compile."""
        if self._file is not None:
            with suppress(OSError):  # a child that was forked meanwhile has the file open as well
                fcntl.flock(self._file, fcntl.LOCK_UN)
            os.close(self._file)
            self._file = None


def _locked(file: int) -> bool:
    """Locks a file, unless another process has."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


class _CheckedFile(IndexDataCacheFile):
    """The index and the code files of one kernel; after each pickle, which ends by itself, stands its checksum."""

    def _dump(self, obj: Any) -> bytes:
        content: bytes = super()._dump(obj)
        return content + hashlib.sha256(content).digest()

    def _load_index(self) -> dict[Any, str]:
        try:
            overloads: dict[Any, str] = super()._load_index()
        except Exception as error:  # a damaged pickle raises anything
            log.info("%s: damaged, compiled again: %s", self._index_path, error)
            return {}
        return overloads

    def _load_data(self, name: str) -> Any:
        """Raises OSError, which counts as a missing file, when the file is damaged."""
        content = Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(content[:-_CHECKSUM]).digest() != content[-_CHECKSUM:]:
            log.info("%s: damaged, compiled again", self._data_path(name))
            raise OSError(f"{name}: damaged")
        for path in (self._index_path, self._data_path(name)):
            used(Path(path))
        return super()._load_data(name)

    def tidy(self) -> None:
        """Removes what nobody has used for longest where there is too much."""
        tidy(Path(self._cache_path), Path(self._index_path))
