"""Blocks as types that a FORTE has built in: strict C, names that tell versions apart, and a device that has them."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from dtwin.cli import main
from dtwin.errors import FunctionBlockError
from dtwin.parameters import ROOT
from iec61499 import model
from iec61499.deploy.build import suited
from iec61499.deploy.cpp_export import built_in_type, module_files
from iec61499.deploy.device_type import TypeExport, is_built_in, original_name
from iec61499.deploy.lua_export import export_type
from iec61499.deploy.plan import Deployment, plan_deployment
from iec61499.library import Library
from iec61499.mapping import resource_network
from tests.support.iec61499.networks import chart

BLOCKS = ROOT / "fb"
CC = shutil.which("cc")
needs_cc = pytest.mark.skipif(CC is None, reason="no system compiler cc, whose warnings are looked at")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-ffp-contract=off")
COUNT = chart(
    "COUNT",
    "UP(K), FAIL -> CNF(N), HALF(N)",
    "K: INT; F: LREAL[3] -> N: INT; T: STRING",
    {
        "START": [],
        "ON": [("N := N + K; T := CONCAT(T, 'x');", "CNF"), ("N := N + 1;", "HALF")],
        "BAD": [("N := V[N];", "")],
    },
    [("START", "UP", "ON"), ("START", "FAIL", "BAD"), ("ON", "1", "START"), ("BAD", "1", "START")],
    "V: INT[2]",
)


def planned(export: TypeExport, library: Library | None = None) -> Deployment:
    library = library or Library([BLOCKS])
    network = resource_network(library.load_system(BLOCKS / "dtwin.sys"))
    return plan_deployment("EMB_RES", network, library, None, export)


@needs_cc
def test_the_types_of_the_cell_are_strict_c(tmp_path: Path) -> None:
    assert main(["fb", "export", "--format", "forte", str(tmp_path)]) == 0
    folder = tmp_path / "dtwin"
    build = (folder / "CMakeLists.txt").read_text()
    sources = re.findall(r"\S+\.c\b", build)
    assert len(sources) == 16
    command = [str(CC), *STRICT, "-fsyntax-only", *(str(folder / name) for name in sources)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.stderr == ""
    assert done.returncode == 0


MAIN = """
#include "module.h"
static char state[4096];
static int16_t number(size_t offset)
{
    int16_t value;
    memcpy(&value, state + offset, sizeof value);
    return value;
}
static void issue(void *block, uint16_t output)
{
    const struct dtwin_type *type = block;
    printf("issued %s with %d\\n", type->event_outputs[output].name, number(type->outputs[0].offset));
}
int main(void)
{
    const struct dtwin_type *type = DTWIN_MODULE[0];
    struct dtwin_execution execution;
    const int16_t by = 5;
    uint16_t event;
    int32_t chart;
    printf("%s %s %s\\n", type->name, type->inputs[1].type, type->outputs[1].type);
    printf("%d %d\\n", type->event_inputs[0].with[0], type->event_inputs[0].with[1]);
    memcpy(state, type->initial, type->size);
    memcpy(state + type->inputs[0].offset, &by, sizeof by);
    for (event = 0; event < type->event_input_count; ++event) {
        memset(&execution, 0, sizeof execution);
        execution.run.iterations = FB_ITERATIONS;
        execution.block = (void *)(uintptr_t)type;
        execution.issue = issue;
        type->execute(state, &execution.run, event);
        memcpy(&chart, state + type->chart, sizeof chart);
        printf("fault %d, state %d, N %d\\n", execution.run.fault.problem, chart, number(type->outputs[0].offset));
    }
    return 0;
}
"""


@needs_cc
def test_an_execution_issues_events_with_the_data_of_their_moment(tmp_path: Path) -> None:
    kind = built_in_type(COUNT)
    for name, text in module_files("counting", [kind]).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "counting" / "main.c").write_text(MAIN)
    sources = [str(path) for path in (tmp_path / "counting").glob("*.c")]
    subprocess.run(
        [str(CC), "-std=c99", "-ffp-contract=off", "-o", str(tmp_path / "run"), *sources, "-lm"], check=True
    )
    done = subprocess.run([str(tmp_path / "run")], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        f"{kind.name} LREAL STRING",
        "0 -1",
        "issued CNF with 5",
        "issued HALF with 6",
        "fault 0, state 0, N 6",
        # an index out of range: the algorithm changes nothing
        "fault 1, state 0, N 6",
    ]


DICTIONARIES = {
    2024: """
        struct CStringDictionary {
            typedef size_t TStringId;
            static CStringDictionary &getInstance() { static CStringDictionary one; return one; }
            TStringId insert(const char *text) { return strlen(text); }
        };""",
    2025: """
        struct CStringDictionary {
            typedef size_t TStringId;
            static TStringId insert(const char *text) { return strlen(text); }
        };""",
}
"""How development versions of FORTE keep names."""
INTERFACES = {
    2024: "struct SFBInterfaceSpec { const CStringDictionary::TStringId *mEINames; };",
    2025: "struct SFBInterfaceSpec { const CStringDictionary::TStringId *mEITypeNames, *mEOTypeNames; };",
}
VERSIONS = """
#include <stdio.h>
#include "module.h"
#include "versions.h"
int main() {
    const dtwin_event &input = DTWIN_MODULE[0]->event_inputs[0];
    const dtwin::Id types[] = {dtwin::idOf(input.type)};
    SFBInterfaceSpec interface = {};
    dtwin::setEventTypes(interface, types, nullptr, 0);
    printf("%s %zu %d", input.type, types[0], *reinterpret_cast<void **>(&interface) == types);
}
"""


@needs_cc
@pytest.mark.skipif(shutil.which("c++") is None, reason="no system compiler c++")
@pytest.mark.parametrize("year", [2024, 2025])
def test_the_module_fits_a_forte_of_either_year(tmp_path: Path, year: int) -> None:
    """What differs: whether the dictionary of names has an instance, and interfaces the types of events."""
    first, *others = COUNT.interface.event_inputs
    interface = replace(COUNT.interface, event_inputs=(replace(first, type="EInit"), *others))
    for name, text in module_files("counting", [built_in_type(replace(COUNT, interface=interface))]).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    folder = tmp_path / "counting"
    (folder / "stringdict.h").write_text(f"#pragma once\n#include <string.h>\n{DICTIONARIES[year]}\n")
    (folder / "funcbloc.h").write_text(f'#pragma once\n#include "stringdict.h"\n{INTERFACES[year]}\n')
    (folder / "main.cc").write_text(VERSIONS)
    objects = [str(path) for path in folder.glob("*.c")]
    subprocess.run([str(CC), "-std=c99", "-c", *objects], check=True, cwd=folder)
    made = [str(path) for path in folder.glob("*.o")]
    strict = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fno-rtti", "-fno-exceptions"]
    subprocess.run(["c++", *strict, "-I.", "-o", "run", "main.cc", *made, "-lm"], check=True, cwd=folder)
    done = subprocess.run([str(folder / "run")], capture_output=True, text=True, check=True)
    assert done.stdout == f"EInit 5 {int(year == 2025)}"


def test_the_name_tells_versions_apart() -> None:
    kind = built_in_type(COUNT)
    assert is_built_in(kind.name)
    assert original_name(kind.name) == "COUNT"
    lua = export_type(COUNT)
    assert not is_built_in(lua.name)
    assert original_name(lua.name) == "COUNT"
    algorithm = replace(COUNT.algorithms[1], source=model.Source("N := N + 2;"))
    changed = replace(COUNT, algorithms=(COUNT.algorithms[0], algorithm, *COUNT.algorithms[2:]))
    assert built_in_type(changed).name != kind.name
    assert built_in_type(COUNT) == kind


def test_types_that_are_built_in_begin_with_their_initial_values() -> None:
    lua, built_in = planned(export_type), planned(built_in_type)
    assert [kind.text for kind in built_in.types] == [""] * len(lua.types)
    subjects = [str(command.request) for command in built_in.commands]
    assert not any("FBType" in subject for subject in subjects)
    # a parameter of the system is written in both, the initial value of an internal variable only to Lua
    written = {line.rpartition(" to ")[2] for line in subjects if line.startswith("WRITE")}
    written_to_lua = {str(c.request).rpartition(" to ")[2] for c in lua.commands if c.request.action == "WRITE"}
    assert written < written_to_lua
    assert "EMULATOR.ID" in written


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("D: DATE -> ", "variable D: DATE cannot be built into 4diac FORTE"),
        ("-> C: CHAR", "variable C: CHAR cannot be built into 4diac FORTE"),
        ("W: WSTRING -> ", "WSTRING is not supported"),
    ],
)
def test_what_forte_does_not_hold_as_c_does_is_refused(data: str, message: str) -> None:
    block = chart("OTHER", "E -> ", data, {"START": []}, [])
    with pytest.raises(FunctionBlockError, match=re.escape(message)):
        built_in_type(block)


class Device:
    """What `suited` asks a device."""

    def __init__(self, *names: str) -> None:
        self._names = names

    def types(self) -> tuple[str, ...]:
        return self._names


def test_a_device_gets_built_in_types_only_if_it_has_all_of_them() -> None:
    names = [kind.name for kind in planned(built_in_type).types]
    for has, expected in ((names, built_in_type), (names[1:], export_type), ([], export_type)):
        assert suited(Device("E_SWITCH", *has), planned) == planned(expected)
