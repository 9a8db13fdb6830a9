"""Imports go one way: each module may import only from the layers below its own."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LAYERS = [
    {"dtwin.errors"},
    {"dtwin.parameters"},
    {"dtwin.signals"},
    {"dtwin.twin_messages"},
    {"dtwin.messages", "dtwin.codec"},
    {"dtwin.recording", "dtwin.bus"},
    {"dtwin.view"},
    {"dtwin.emulation", "dtwin.twin", "dtwin.iec61499"},
    {"dtwin.control"},
    {"dtwin.loop"},
    {"dtwin.cell", "dtwin.remote", "dtwin.motion"},
    {"dtwin.live"},
    {"dtwin.identification"},
    {
        "dtwin.validation",
        "dtwin.benchmark",
        "dtwin.application",
        "dtwin.runfile",
        "dtwin.supervisor",
        "dtwin.monitoring",
        "dtwin.simulation",
    },
    {"dtwin.recovery"},
    {"services", "dtwin.commands", "dtwin.cli", "dtwin.__main__"},
]
OWNERS = {"mujoco": "dtwin.emulation", "zenoh": "dtwin.bus", "rerun": "dtwin.view", "rerun_loader_mjcf": "dtwin.view"}
MODULES = sorted([*ROOT.glob("dtwin/**/*.py"), *ROOT.glob("services/**/*.py")])


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def layer_of(name: str) -> int | None:
    return next((i for i, layer in enumerate(LAYERS) if any(within(name, package) for package in layer)), None)


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_imports_only_from_below(path: Path) -> None:
    name = name_of(path)
    if name in ("dtwin", "services"):
        return
    own = layer_of(name)
    assert own is not None, f"{name} stands in no layer"
    own_package = next(package for package in LAYERS[own] if within(name, package))
    for imported in imports(path):
        layer = layer_of(imported)
        if layer is not None and not within(imported, own_package):
            assert layer < own or own == len(LAYERS) - 1, f"{name} imports {imported}"


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_libraries_have_one_owner(path: Path) -> None:
    for imported in imports(path):
        owner = OWNERS.get(imported.split(".")[0])
        assert owner is None or within(name_of(path), owner), f"{name_of(path)} imports {imported}"
