"""Which libraries a process loads before it works: each costs time at the start and memory for as long as it runs."""

import subprocess
import sys

import pytest

from dtwin.parameters import ROOT

HEAVY = frozenset({"numpy", "scipy", "numba", "mujoco", "rerun", "pyarrow", "lark", "matplotlib"})
DEAREST = frozenset({"scipy.stats", "scipy.optimize", "rerun", "matplotlib"})
"""no service loads them to start"""


def loaded(*modules: str) -> set[str]:
    """What a new process has loaded once it has imported the modules."""
    code = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60
    )
    return set(done.stdout.split())


@pytest.mark.parametrize(
    "module",
    [
        "services.launch",
        "services.supervisor",
        "services.bridge",
        "dtwin.commands.live.up",
        "dtwin.commands.live.stop",
        "dtwin.commands.live.watch",
        "dtwin.commands.live.settings",
        "dtwin.identification.store",
    ],
)
def test_what_only_waits_or_asks_loads_no_library_of_numbers(module: str) -> None:
    assert not loaded(module) & HEAVY


@pytest.mark.parametrize(
    ("name", "needed"),
    [
        ("controller", {"lark"}),
        ("emulator", {"numpy", "mujoco"}),
        ("recorder", {"numpy", "pyarrow"}),
        ("identification", set()),
        ("monitoring", {"numpy", "scipy", "numba"}),
        ("simulation", {"numpy", "scipy", "numba", "lark"}),
    ],
)
def test_services_load_what_they_need(name: str, needed: set[str]) -> None:
    found = loaded(f"services.{name}")
    assert found & HEAVY == needed
    assert not found & DEAREST
