"""Compiled kernels on disk: found again by other processes, and made anew when they are damaged."""

import importlib
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Final

import pytest
from numba.core.registry import CPUDispatcher

from dtwin.twin import compiled

SOURCE = """
from dtwin.twin.compiled import kernel

@kernel
def twice(x):
    return x + x

print(twice(21.0), *twice.stats.cache_hits.values())
"""
HARM: Final[dict[str, Callable[[bytes], bytes]]] = {
    "cut": lambda content: content[: len(content) // 2],
    "changed": lambda content: content[: (k := len(content) // 2)] + bytes([content[k] ^ 0xFF]) + content[k + 1 :],
    "empty": lambda content: b"",
}
"""What becomes of the content of a file."""


def run(folder: Path, *names: str, **variables: str) -> list[list[str]]:
    """The results of the kernels of some modules and how often each was found, in a new process."""
    return results(start(folder, *names, **variables))


def start(folder: Path, *names: str, **variables: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", f"import {', '.join(names)}"],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(folder), *sys.path]),
            "DTWIN_CACHE_DIR": str(folder / "kept"),
            **variables,
        },
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def results(process: subprocess.Popen[str]) -> list[list[str]]:
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    return [line.split() for line in out.splitlines()]


def write_kernels(folder: Path, *names: str) -> None:
    """Writes a module with a kernel under every name."""
    for name in names:
        (folder / f"{name}.py").write_text(SOURCE)


def test_damaged_files_are_made_anew(tmp_path: Path) -> None:
    damaged = {f"{how}_{suffix}": (how, suffix) for how in HARM for suffix in ("nbi", "nbc")}
    names = [*damaged, "whole"]
    write_kernels(tmp_path, *names)
    assert run(tmp_path, *names) == [["42.0"]] * 7
    for name, (how, suffix) in damaged.items():
        (file,) = (tmp_path / "kept").glob(f"{name}.twice-*.{suffix}")
        file.write_bytes(HARM[how](file.read_bytes()))
    again = dict(zip(names, run(tmp_path, *names), strict=True))
    assert again.pop("whole") == ["42.0", "1"]
    assert again == {name: ["42.0"] for name in damaged}
    assert run(tmp_path, *names) == [["42.0", "1"]] * 7


INNER = """
from dtwin.twin.compiled import kernel

@kernel
def twice(x):
    return x + x
"""
MIDDLE = """
import inner
from dtwin.twin.compiled import kernel

@kernel(uses=(inner,))
def quadruple(x):
    return inner.twice(inner.twice(x))
"""
OUTER = """
import middle
from dtwin.twin.compiled import kernel

@kernel(uses=(middle,))
def run(x):
    return middle.quadruple(x)
"""
SCALING = """
from dtwin.twin.compiled import kernel
from structure import FACTOR, Pair

@kernel
def scaled(pair):
    return FACTOR * pair.first
"""
STRUCTURE = """
from typing import NamedTuple
FACTOR = 10.0
class Pair(NamedTuple):
    first: float
    second: float
"""
Checkout = Callable[..., ModuleType]
"""checkout(name, module=text, ...): the last of some modules, imported anew from a folder of that name."""


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Checkout]:
    monkeypatch.setenv("DTWIN_CACHE_DIR", str(tmp_path / "kept"))
    monkeypatch.setattr(
        sys, "dont_write_bytecode", True
    )  # a text of the same length and second would be taken for it
    imported: set[str] = set()

    def load(folder: str, **texts: str) -> ModuleType:
        place = tmp_path / folder
        place.mkdir(exist_ok=True)
        imported.update(texts)
        for name, text in texts.items():
            (place / f"{name}.py").write_text(text)
            sys.modules.pop(name, None)
        with monkeypatch.context() as patch:
            patch.syspath_prepend(str(place))
            return importlib.import_module(list(texts)[-1])

    yield load
    for name in imported:
        sys.modules.pop(name, None)


def scaled(module: ModuleType) -> tuple[float, int]:
    """The result of the kernel of SCALING, and how often its machine code was found."""
    return module.scaled(module.Pair(first=1.0, second=2.0)), sum(module.scaled.stats.cache_hits.values())


def test_a_kernel_is_made_anew_when_one_has_changed_that_those_use_which_it_calls(checkout: Checkout) -> None:
    for inner, result, hits in ((INNER, 40.0, 0), (INNER, 40.0, 1), (INNER.replace("x + x", "x + x + x"), 90.0, 0)):
        outer = checkout("one", inner=inner, middle=MIDDLE, outer=OUTER)
        assert (outer.run(10.0), sum(outer.run.stats.cache_hits.values())) == (result, hits)


def test_checkouts_with_the_same_sources_have_the_same_code(checkout: Checkout) -> None:
    same = {"structure": STRUCTURE, "scaling": SCALING}
    assert scaled(checkout("first", **same)) == (10.0, 0)
    assert scaled(checkout("second", **same)) == (10.0, 1)
    other = SCALING.replace("pair.first", "-pair.first")
    assert scaled(checkout("second", structure=STRUCTURE, scaling=other)) == (-10.0, 0)
    assert scaled(checkout("first", **same)) == (10.0, 1)


def test_a_kernel_is_made_anew_for_another_constant_or_structure(checkout: Checkout) -> None:
    turned = STRUCTURE.replace("first", "third").replace("second", "first").replace("third", "second")
    for structure, result in ((STRUCTURE, 10.0), (STRUCTURE.replace("10.0", "20.0"), 20.0), (turned, 10.0)):
        assert scaled(checkout("first", structure=structure, scaling=SCALING)) == (result, 0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_kernels(tmp_path, "kernels")
    return tmp_path


def test_the_code_is_in_the_users_cache(folder: Path) -> None:
    cache = folder / "home" / ".cache"
    variables = {"XDG_CACHE_HOME": str(cache), "HOME": str(folder / "home"), "DTWIN_CACHE_DIR": ""}
    assert run(folder, "kernels", **variables) == [["42.0"]]
    assert run(folder, "kernels", **variables) == [["42.0", "1"]]
    assert list(cache.rglob("*.nbc"))


@pytest.fixture
def homeless(folder: Path) -> dict[str, str]:
    """What lets a process have no folder but that of temporary files."""
    (folder / "home").write_text("in the way")
    (folder / "tmp").mkdir()
    nowhere = dict.fromkeys(("XDG_CACHE_HOME", "HOME"), str(folder / "home"))
    return {**nowhere, "DTWIN_CACHE_DIR": "", "TMPDIR": str(folder / "tmp")}


def test_a_user_without_a_home_has_a_folder_of_the_own_among_temporary_files(
    folder: Path, homeless: dict[str, str]
) -> None:
    assert run(folder, "kernels", **homeless) == [["42.0"]]
    assert run(folder, "kernels", **homeless) == [["42.0", "1"]]
    (own,) = (folder / "tmp").iterdir()
    assert own.stat().st_mode & 0o777 == 0o700
    assert list(own.rglob("*.nbc"))


def test_without_any_folder_every_process_compiles(folder: Path, homeless: dict[str, str]) -> None:
    (folder / "tmp" / f"dtwin-{os.geteuid()}").mkdir(mode=0o755)  # others may read it
    assert run(folder, "kernels", **homeless) == [["42.0"]]
    assert run(folder, "kernels", **homeless) == [["42.0"]]


def test_of_processes_that_start_together_one_compiles(folder: Path) -> None:
    together = [start(folder, "kernels") for _ in range(3)]
    assert sorted(results(process) for process in together) == [[["42.0"]], [["42.0", "1"]], [["42.0", "1"]]]


HOLDS = (
    "import fcntl, sys; file = open(sys.argv[1], 'w'); fcntl.flock(file, fcntl.LOCK_EX); print(flush=True); input()"
)


def test_what_a_killed_process_had_locked_is_free(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    holder = subprocess.Popen([sys.executable, "-c", HOLDS, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    with holder, path.open("w") as file:
        assert holder.stdout is not None
        holder.stdout.readline()
        assert not compiled._locked(file.fileno())
        holder.kill()
        holder.wait()
        assert compiled._locked(file.fileno())


def test_a_lock_that_is_never_released_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "_LONGEST", 0.1)
    lock = compiled._Lock(tmp_path / "new" / "a.lock")
    other = compiled._Lock(tmp_path / "new" / "a.lock")
    lock.acquire()
    other.acquire()
    other.release()
    with open(tmp_path / "new" / "a.lock") as file:
        assert not compiled._locked(file.fileno())
        lock.release()
        assert compiled._locked(file.fileno())


def test_every_module_that_a_kernel_names_is_one_of_those_that_count() -> None:
    """Machine code has the constants of these modules in it, too."""
    for name in ("dtwin.monitoring.monitor", "dtwin.run.machine_code.cell", "dtwin.simulation.figures"):
        importlib.import_module(name)
    of_dtwin = [module for name, module in sys.modules.items() if name.startswith("dtwin.")]
    kernels = {v for module in of_dtwin for v in vars(module).values() if isinstance(v, CPUDispatcher)}
    kept = [kernel for kernel in kernels if isinstance(kernel._cache, compiled._Cache)]
    assert len(kept) > 30
    for kernel in kept:
        named = (vars(sys.modules[kernel.py_func.__module__]).get(name) for name in kernel.py_func.__code__.co_names)
        assert {
            each for each in named if isinstance(each, ModuleType) and each in of_dtwin
        } <= kernel._cache.modules.keys(), kernel
