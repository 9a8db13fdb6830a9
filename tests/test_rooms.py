"""Imports go one way: a room imports only rooms below its own, and libraries have one owner. docs/architecture.md
draws the same."""

import ast
from collections import Counter
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FLOORS = [
    {"iec61499"},
    {"dtwin.lengths"},
    {"dtwin.errors", "dtwin.optional"},
    {"dtwin.files", "dtwin.names", "dtwin.options", "dtwin.parameters", "dtwin.terminal"},
    {"dtwin.signals", "dtwin.task", "dtwin.line_file", "dtwin.settings", "dtwin.arm"},
    {"dtwin.bus", "dtwin.emulation", "dtwin.twin", "dtwin.controller", "dtwin.equations", "dtwin.loop"},
    {"dtwin.logs", "dtwin.measurements"},
    {"dtwin.run", "dtwin.fmu", "dtwin.campaign"},
    {"dtwin.pictures"},
    {"dtwin.view", "dtwin.identification"},
    {"dtwin.monitoring", "dtwin.simulation", "dtwin.health"},
    {"dtwin.commissioning", "dtwin.recovery"},
    {"dtwin.line"},
    {"dtwin.console"},
    {"dtwin.ai"},
    {"dtwin.services"},
    {"dtwin.api"},
    {"dtwin.commands"},
    {"evidence"},
    {"dtwin.cli"},
    {"dtwin.__main__"},
]
"""From the ground up; rooms of one floor do not know each other."""
ALONE = "iec61499"
"""a distribution of its own, which imports nothing of the project"""
SUBROOMS = [
    {f"{ALONE}.errors"},
    {f"{ALONE}.output"},
    {f"{ALONE}.types"},
    {f"{ALONE}.literals"},
    {f"{ALONE}.model", f"{ALONE}.st"},
    {f"{ALONE}.mapping", f"{ALONE}.opening", f"{ALONE}.files"},
    {f"{ALONE}.standard"},
    {f"{ALONE}.acknowledged"},
    {f"{ALONE}.distribution"},
    {f"{ALONE}.library"},
    {f"{ALONE}.runtime"},
    {f"{ALONE}.trace", f"{ALONE}.departures"},
    {f"{ALONE}.native"},
    {f"{ALONE}.net"},
    {f"{ALONE}.management"},
    {f"{ALONE}.deploy", f"{ALONE}.inspection"},
    {f"{ALONE}.lint"},
    {f"{ALONE}.device"},
    {f"{ALONE}.testing"},
    {f"{ALONE}.commands"},
    {f"{ALONE}.cli"},
]
"""Inside the function blocks, from the ground up."""
OWNERS = {"mujoco": "dtwin.emulation", "zenoh": "dtwin.bus", "rerun": "dtwin.view", "rerun_loader_mjcf": "dtwin.view"}
PACKAGES = ("dtwin", "evidence", "iec61499", "services")
MODULES = sorted(path for package in PACKAGES for path in ROOT.glob(f"{package}/**/*.py"))
LONGEST = 400
"""lines of a file"""
FULLEST = 16
"""files of a folder"""
LENGTHIEST = 60
"""lines of a function without its docstring"""
MOST_ARGUMENTS = 8
"""arguments of a function that are not given by name"""

MOST_PRIVATE = 12
"""private fields of a class"""
_VIEWS = "views of MuJoCo's memory and numbers of the model, looked up once for all ticks"
_SAMPLE = "not split yet: read in every sample of the monitor"
_TABLES = "tables of the network, read at every event"
CROWDED = {
    "dtwin.emulation.plant.Plant": _VIEWS,
    "dtwin.emulation.contact.bodies.Bodies": _VIEWS,
    "dtwin.monitoring.candidate.Candidate": _SAMPLE,
    "dtwin.monitoring.diagnosis.Diagnosis": _SAMPLE,
    "dtwin.monitoring.estimation.estimator.Estimator": _SAMPLE,
    "dtwin.monitoring.monitor.Monitor": _SAMPLE,
    "dtwin.monitoring.sensing.gripper.GripperWatch": _SAMPLE,
    "dtwin.monitoring.sensing.readings.Readings": _SAMPLE,
    "iec61499.runtime.resource.Resource": _TABLES,
}
"""Classes with more private fields, and why; no other may have more."""


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    if parts[0] == "services":  # dtwin/services is a link to it.
        parts = ("dtwin", *parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def nodes(path: Path) -> list[ast.AST]:
    """What the tests look at in a file, read once for all of them."""
    kinds = (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    return [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, kinds)]


@cache
def imports(path: Path) -> set[str]:
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def within(name: str, room: str) -> bool:
    return name == room or name.startswith(f"{room}.")


def place(name: str, floors: list[set[str]]) -> tuple[int, str] | None:
    """The floor and the room that a module stands in."""
    places = ((number, room) for number, floor in enumerate(floors) for room in floor if within(name, room))
    return next(places, None)


def imports_from_above(path: Path, floors: list[set[str]]) -> Iterator[str]:
    """The imports that come neither from the module's own room nor from a lower floor."""
    name = name_of(path)
    own = place(name, floors)
    assert own is not None, f"{name} stands in no room"
    for imported in imports(path):
        other = place(imported, floors)
        if other is not None and other[1] != own[1] and other[0] >= own[0]:
            yield f"{name} imports {imported}"


BLOCKS = [path for path in MODULES if within(name_of(path), ALONE)]


def test_rooms_import_from_below() -> None:
    rooms = [path for path in MODULES if name_of(path) != "dtwin"]
    wrong = [line for path in rooms for line in imports_from_above(path, FLOORS)]
    assert not wrong, wrong


def test_function_blocks_stand_alone() -> None:
    wrong = [
        f"{name_of(path)} imports {imported}"
        for path in BLOCKS
        for imported in imports(path)
        if within(imported, "dtwin")
    ]
    assert not wrong, wrong


def test_function_blocks_import_from_below() -> None:
    rooms = [path for path in BLOCKS if name_of(path) != ALONE]
    wrong = [line for path in rooms for line in imports_from_above(path, SUBROOMS)]
    assert not wrong, wrong


def test_modules_import_in_no_circle() -> None:
    modules = {name_of(path): path for path in MODULES if name_of(path) != "dtwin"}
    graph = {}
    for name, path in modules.items():
        imported = imports(path)
        graph[name] = {other if other in modules else other.rpartition(".")[0] for other in imported} & set(modules)
    TopologicalSorter(graph).prepare()


def test_libraries_have_one_owner() -> None:
    owned = [(name_of(path), imported) for path in MODULES for imported in imports(path)]
    wrong = [
        f"{name} imports {imported}"
        for name, imported in owned
        if (owner := OWNERS.get(imported.split(".")[0])) is not None and not within(name, owner)
    ]
    assert not wrong, wrong


def test_files_and_folders_stay_small() -> None:
    long = [name_of(path) for path in MODULES if len(path.read_text().splitlines()) > LONGEST]
    files = {file for path in MODULES for file in path.parent.iterdir() if file.is_file()}
    folders = Counter(file.parent for file in files)
    full = [str(folder.relative_to(ROOT)) for folder, count in folders.items() if count > FULLEST]
    assert not long
    assert not full


def length_and_arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> tuple[int, int]:
    """Lines of a function without its docstring, and its arguments that are not given by name."""
    first, given = function.body[0], [*function.args.posonlyargs, *function.args.args]
    described = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    documented = (first.end_lineno or 0) - first.lineno + 1 if described else 0
    own = bool(given) and given[0].arg in ("self", "cls")
    return (function.end_lineno or 0) - function.lineno + 1 - documented, len(given) - own


def test_functions_stay_short() -> None:
    wrong = [
        f"{name_of(path)}.{node.name}: {lines} lines, {arguments} arguments"
        for path in MODULES
        for node in nodes(path)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        for lines, arguments in [length_and_arguments(node)]
        if lines > LENGTHIEST or arguments > MOST_ARGUMENTS
    ]
    assert not wrong


def assigned(statement: ast.AST) -> Iterator[ast.expr]:
    """What a statement assigns to, each part of a tuple by itself."""
    targets: list[ast.expr] = []
    if isinstance(statement, ast.Assign):
        targets = statement.targets
    elif isinstance(statement, ast.AnnAssign | ast.AugAssign):
        targets = [statement.target]
    for target in targets:
        yield from target.elts if isinstance(target, ast.Tuple | ast.List) else [target]


def private_fields(kind: ast.ClassDef) -> set[str]:
    """The private fields of a class: those of self, and those that a dataclass declares."""
    own = {
        target.attr
        for statement in ast.walk(kind)
        for target in assigned(statement)
        if isinstance(target, ast.Attribute) and ast.unparse(target.value) == "self"
    }
    declared = {
        statement.target.id
        for statement in kind.body
        if isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name)
        if not ast.unparse(statement.annotation).startswith(("ClassVar", "Final"))
    }
    return {name for name in own | declared if name.startswith("_")}


def test_classes_have_few_private_fields() -> None:
    crowded = {
        f"{name_of(path)}.{node.name}"
        for path in MODULES
        for node in nodes(path)
        if isinstance(node, ast.ClassDef) and len(private_fields(node)) > MOST_PRIVATE
    }
    assert crowded <= set(CROWDED), crowded - set(CROWDED)
