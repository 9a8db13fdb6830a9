"""Which libraries a process loads before it works: each costs time at the start and memory for as long as it runs."""

import subprocess
import sys

import pytest

from dtwin.parameters import ROOT
from dtwin.twin.compiled import BLAS

HEAVY = frozenset({"numpy", "scipy", "numba", "mujoco", "rerun", "pyarrow", "lark", "matplotlib"})
DEAREST = frozenset({"scipy.stats", "scipy.signal", "scipy.optimize", "scipy.interpolate", "rerun", "matplotlib"})
"""no service loads them to start"""


def after(code: str) -> set[str]:
    """What a new process has loaded once it has run the code."""
    command = [sys.executable, "-c", f"{code}; import sys; print(*sys.modules)"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=120)
    return set(done.stdout.split())


def loaded(*modules: str) -> set[str]:
    """What a new process has loaded once it has imported the modules."""
    return after(f"import {', '.join(modules)}")


WAITING = (
    *("dtwin.services.launch", "dtwin.services.supervisor", "dtwin.services.bridge", "dtwin.commands.live.up"),
    *("dtwin.commands.live.status", "dtwin.commands.live.stop", "dtwin.commands.live.watch"),
    *("dtwin.commands.live.settings", "dtwin.identification.store"),
)
"""Modules of what only waits or asks."""


def test_what_only_waits_or_asks_loads_no_library_of_numbers() -> None:
    """All in one process, as none may load any."""
    assert not loaded(*WAITING) & HEAVY


def test_a_word_to_a_cell_waits_for_neither_parser_nor_cell() -> None:
    words = ("status", "stop", "release", "down")
    said = "; ".join(f"assert main(['{word}', '--cell', 'none']) == 2" for word in words)
    found = after(f"from dtwin.cli import main; {said}")
    assert not found & {*HEAVY, "tyro"}
    assert not {name for name in found if name.startswith(("dtwin.run", "dtwin.controller", "dtwin.emulation"))}


@pytest.mark.parametrize(
    ("name", "needed"),
    [
        ("controller", {"lark"}),
        ("emulator", {"numpy", "mujoco"}),
        ("recorder", {"numpy", "pyarrow"}),
        ("console", set()),
        ("identification", set()),
        ("monitoring", {"numpy", "scipy", "numba"}),
        ("simulation", {"numpy", "scipy", "numba", "lark"}),
        ("recovery", {"numpy", "scipy", "numba", "lark"}),
    ],
)
def test_services_load_what_they_need(name: str, needed: set[str]) -> None:
    found = loaded(f"dtwin.services.{name}")
    assert found & HEAVY == needed
    assert not found & DEAREST


@pytest.mark.parametrize(
    ("name", "needed"),
    [
        *((name, {"numpy", "mujoco", "lark"}) for name in ("emulator", "bridge", "recovery", "console", "check")),
        ("recorder", {"numpy", "mujoco", "lark", "pyarrow"}),
        ("simulation", {"numpy", "mujoco", "lark"}),
        ("monitoring", {"numpy", "mujoco", "lark"}),
        ("identification", {"numpy", "mujoco", "lark", "scipy"}),
    ],
)
def test_services_of_another_arm_read_its_model_and_load_what_they_need(name: str, needed: set[str]) -> None:
    found = loaded(f"dtwin.services.chain.{name}")
    assert found & HEAVY == needed
    assert not found & DEAREST


@pytest.mark.parametrize("name", ["services.line.plant", "services.line.zone", "commands.line.up", "api.cell"])
def test_lines_and_runs_wait_for_no_library_that_they_seldom_need(name: str) -> None:
    assert not loaded(f"dtwin.{name}") & DEAREST


def test_the_package_loads_nothing_before_a_name_is_used() -> None:
    found = after("import dtwin; dtwin.DtwinError")
    assert {name for name in found if name.startswith("dtwin")} == {"dtwin", "dtwin.errors"}
    assert not found & HEAVY


def test_the_monitor_at_work_has_loaded_of_scipy_only_the_products_of_matrices() -> None:
    found = after(
        "import dtwin.services.monitoring as service; belief = service.Options()._belief();"
        "[act() for _, act in service.Rehearsal(belief, service.MonitorSettings()).parts()]"
    )
    assert {name for name in found if name.startswith(("scipy.linalg", "scipy.special"))} == {BLAS}
    assert not found & {"numpy.f2py", "unittest"}


def test_what_is_loaded_alone_is_part_of_its_package_later() -> None:
    code = (
        f"import dtwin.twin.compiled, sys; alone = sys.modules['{BLAS}']; from scipy.linalg import cython_blas, inv"
    )
    assert BLAS in after(f"{code}; assert cython_blas is alone; assert inv([[2.0]]) == 0.5")
