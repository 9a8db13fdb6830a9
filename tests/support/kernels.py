"""The kernels of this process: which there are, who calls them, and which are loaded."""

import gc
import sys
from collections.abc import Iterator
from types import CodeType, FunctionType, ModuleType
from typing import Any

from numba.core.registry import CPUDispatcher


def loaded() -> set[tuple[str, str, str]]:
    """Module, name and signature of every machine code that is there to be called."""
    kernels = [each for each in gc.get_objects() if isinstance(each, CPUDispatcher)]
    return {
        (kernel.py_func.__module__, kernel.py_func.__name__, str(signature))
        for kernel in kernels
        for signature in kernel.signatures
    }


def never_called(package: str, but: tuple[str, ...] = ()) -> set[str]:
    """Names of the kernels that Python functions of a package call, and that nobody has called yet.

    Args:
        package: name of the package.
        but: its modules that do not count.
    """
    modules = [module for name, module in sys.modules.items() if name.startswith(package) and name not in but]
    named = [kernel for module in modules for function in _functions(module) for kernel in _named(function)]
    return {kernel.py_func.__name__ for kernel in named if not kernel.signatures}


def _functions(module: ModuleType) -> Iterator[FunctionType]:
    """The functions and methods that a module defines."""
    for value in vars(module).values():
        members = vars(value).values() if isinstance(value, type) and value.__module__ == module.__name__ else [value]
        for member in members:
            function = getattr(member, "fget", None) or getattr(member, "__func__", member)
            if isinstance(function, FunctionType) and function.__module__ == module.__name__:
                yield function


def _named(function: FunctionType) -> Iterator[CPUDispatcher]:
    """The kernels of which a function has the names."""
    names = set(_names(function.__code__))
    for value in [function.__globals__.get(name) for name in names]:
        found: list[Any] = [value]
        if isinstance(value, ModuleType):
            found = [getattr(value, name, None) for name in names]
        yield from (each for each in found if isinstance(each, CPUDispatcher))


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)
