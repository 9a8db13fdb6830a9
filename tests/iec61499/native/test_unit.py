"""A network as a C unit: strict, readable, the same to the bit as Python, and clean under sanitizers."""

from __future__ import annotations

import math
import random
import shutil
import subprocess
from pathlib import Path

import pytest

from dtwin.controller.ports import BLOCKS, EMULATOR, SYSTEM
from dtwin.errors import CommunicationError, FunctionBlockError
from iec61499.library import Library
from iec61499.literals import parse_literal
from iec61499.mapping import resource_network
from iec61499.model import FBNetwork
from iec61499.native.build import unit_files
from iec61499.native.export import c_files
from iec61499.native.layout import network_layout
from iec61499.native.resource import NativeResource
from iec61499.native.unit import unit_of
from iec61499.runtime.resource import Resource
from iec61499.types import TIME
from tests.support.iec61499.c_harness import needs_compiler
from tests.support.iec61499.networks import Types, chart, network

CC = shutil.which("cc")
needs_cc = pytest.mark.skipif(CC is None, reason="no system compiler cc, whose warnings and sanitizers are looked at")
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-ffp-contract=off")
SAMPLES = 400

MAIN = """
#include "dtwin.h"
#include <math.h>
int main(void)
{
    static struct dtwin unit, kept;
    struct dtwin__EMULATOR__request in;
    struct dtwin__EMULATOR__answer out;
    int k;
    memset(&in, 0, sizeof in);
    dtwin__initialise(&unit);
    if (dtwin__cold(&unit) != FB_FINE || dtwin__find("PLANNER.T") == NULL) {
        return 1;
    }
    for (k = 0; k < SAMPLES; ++k) {
        if (k == SAMPLES / 2) {
            kept = unit;
        }
        in.RD_1 = sin(0.01 * k);
        in.RD_2 = -0.3 * in.RD_1;
        in.RD_3 = 0.001 * k;
        in.RD_4 = 0.9;
        in.RD_5 = k % 7 == 0;
        fb_assign(&in.RD_6, k % 2 == 0 ? fb_literal("red", 3) : fb_literal("green", 5));
        if (dtwin__exchange__EMULATOR(&unit, &in, &out) != FB_FINE) {
            return 2;
        }
        printf("%a %a %a %a %d\\n", out.SD_1, out.SD_2, out.SD_3, out.SD_4, (int)out.SD_5);
    }
    unit = kept;
    return dtwin__exchange__EMULATOR(&unit, &in, &out) == FB_FINE ? 0 : 3;
}
"""


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("exported")
    for name, text in c_files(Library([BLOCKS]), BLOCKS / SYSTEM).items():
        (folder / name).write_text(text)
    return folder


def compiled(*options: str) -> subprocess.CompletedProcess[str]:
    assert CC is not None
    return subprocess.run([CC, *options], capture_output=True, text=True, check=False)


@needs_cc
def test_the_unit_of_the_cell_compiles_without_warnings(exported: Path) -> None:
    done = compiled(*STRICT, "-O1", "-c", str(exported / "dtwin.c"), "-o", str(exported / "dtwin.o"))
    assert (done.returncode, done.stderr) == (0, "")
    text = (exported / "dtwin.c").read_text()
    assert "PATH_PLANNER__algorithm__follow" in text
    assert str(BLOCKS) not in text
    assert "malloc" not in text


@needs_cc
def test_the_unit_is_clean_under_sanitizers_and_equals_python(exported: Path) -> None:
    (exported / "main.c").write_text(MAIN.replace("SAMPLES", str(SAMPLES)))
    program, options = exported / "main", ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    sources = (str(exported / "main.c"), str(exported / "dtwin.c"))
    done = compiled(*STRICT, "-O0", *options, *sources, "-o", str(program), "-lm")
    if "cannot find" in done.stderr:
        pytest.skip("the compiler has no libraries of its sanitizers")
    assert done.returncode == 0, done.stderr
    ran = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    library = Library([BLOCKS])
    resource = Resource(resource_network(library.load_system(BLOCKS / SYSTEM)), library)
    server = resource.server(EMULATOR.block)
    resource.start()
    expected = []
    for k in range(SAMPLES):
        first = math.sin(0.01 * k)
        colour = "red" if k % 2 == 0 else "green"
        expected.append(server.exchange((first, -0.3 * first, 0.001 * k, 0.9, k % 7 == 0, colour)))
    lines = [line.split() for line in ran.stdout.splitlines()]
    assert [(*map(float.fromhex, line[:4]), line[4] == "1") for line in lines] == expected


@needs_cc
def test_a_static_analyser_finds_nothing(tmp_path: Path) -> None:
    """In what every unit includes and the code of a small one; that of the cell takes half a minute."""
    unit = unit_of(network_layout(network("A: WORKER; B: E_CTU", "A.CNF -> B.CU"), Types(LOOP)), "small")
    for name, text in unit_files(unit, "small").items():
        (tmp_path / name).write_text(text)
    options = ("-O0", "-fanalyzer", "-c", str(tmp_path / "small.c"), "-o", str(tmp_path / "small.o"))
    done = compiled(*STRICT, *options)
    if "unrecognized" in done.stderr or "unknown argument" in done.stderr:
        pytest.skip("the compiler has no static analyser")
    assert (done.returncode, done.stderr) == (0, "")


LOOP = chart(
    "WORKER",
    "REQ(I) -> CNF(V), AGAIN",
    "I: DINT -> V: DINT",
    {"S": [], "T": [("A[I] := I; V := A[I];", "CNF")], "U": [("V := V + 1;", "")], "W": []},
    [("S", "REQ[I < 8]", "T"), ("T", "1", "S"), ("S", "REQ[I = 9]", "U"), ("U", "1", "W"), ("W", "1", "U")],
    "A: DINT[4]",
)


def both(net: FBNetwork, types: Types) -> tuple[NativeResource, Resource]:
    return NativeResource(net, types), Resource(net, types)


@needs_compiler
@pytest.mark.parametrize("value", [3, 4, -1, 9])
def test_faults_are_those_of_python(value: int) -> None:
    types = Types(LOOP)
    native, python = both(network("A: WORKER"), types)
    messages = []
    for resource in (native, python):
        resource.write("A.I", value)
        message = ""
        try:
            resource.trigger("A.REQ")
            resource.run_until_idle()
        except FunctionBlockError as error:
            message = error.message
        messages.append(message)
    assert messages[0].split("A: ")[-1] == messages[1].split("A: ")[-1] or value == 9
    assert bool(messages[0]) == bool(messages[1]) == (value != 3)
    if value != 9:  # what a chart that never rests has done before it is stopped is not said
        assert native.states() == python.states()


@needs_compiler
def test_an_endless_chain_of_events_is_stopped() -> None:
    ring = network("A: E_MERGE; B: E_MERGE", "A.EO -> B.EI1; B.EO -> A.EI1")
    native, python = both(ring, Types())
    python.trigger("A.EI2")
    with pytest.raises(FunctionBlockError, match="endless loop of events"):
        python.run_until_idle()
    with pytest.raises(FunctionBlockError, match="endless loop of events"):
        native.trigger("A.EI2")


@needs_compiler
def test_a_server_that_does_not_answer_is_a_fault_of_communication() -> None:
    net = network("START: E_RESTART; S: SERVER_1_1", "START.COLD -> S.INIT", "", {"S.QI": "TRUE", "S.ID": "'x'"})
    for resource in both(net, Types()):
        server = resource.server("S")
        with pytest.raises(CommunicationError, match="not initialised"):
            server.exchange((1,))
        resource.start()
        assert resource.read("S.STATUS") == "OK"
        with pytest.raises(CommunicationError, match="answered 0 times"):
            server.exchange((1,))
        with pytest.raises(CommunicationError, match="got 2 values"):
            server.exchange((1, 2))


@needs_compiler
def test_timers_are_those_of_python() -> None:
    kinds = ("FB_TON", "FB_TOF", "FB_TP")
    net = network("; ".join(f"{kind[3:]}: {kind}; COUNT_{kind}: E_CTU" for kind in kinds),
                  "; ".join(f"{kind[3:]}.CNF -> COUNT_{kind}.CU" for kind in kinds))  # fmt: skip
    rng = random.Random(46)
    for time in ("1s", "0s", "-1ms"):
        native, python = both(net, Types())
        for _ in range(200):
            step = rng.choice((0, 1, 250, 999, 1000, 2500)) * 1_000_000
            given = rng.random() < 0.5
            native.advance(step)
            python.advance(step)
            for resource in (native, python):
                for kind in kinds:
                    resource.write(f"{kind[3:]}.IN", given)
                    resource.write(f"{kind[3:]}.PT", parse_literal(f"T#{time}", TIME))
                    resource.trigger(f"{kind[3:]}.REQ")
                resource.run_until_idle()
            assert native.states() == python.states()


def test_blocks_that_c_does_not_have_are_refused() -> None:
    net = network("A: CLIENT_1_1; B: INT2INT; C: INT2INT", "", "B.OUT -> A.SD_1; A.RD_1 -> C.IN")
    with pytest.raises(FunctionBlockError, match="C: A is a CLIENT_1_1: expected basic, simple and composite blocks"):
        unit_of(network_layout(net, Types()), "unit")


@pytest.mark.parametrize(
    ("content", "what"),
    [
        ('<InOutVars><VarDeclaration Name="V" Type="INT"/></InOutVars></InterfaceList>', "the VAR_IN_OUT V"),
        (
            '</InterfaceList><InternalVars><FB Name="late" Type="FB_TON"/></InternalVars>',
            "the block late inside another",
        ),
        ('<OutputVars><VarDeclaration Name="L" Type="Lamp"/></OutputVars></InterfaceList>', "Lamp.* an enumeration"),
    ],
)
def test_variables_that_c_does_not_have_are_refused(tmp_path: Path, content: str, what: str) -> None:
    head, _, rest = content.partition("</InterfaceList>")
    (tmp_path / "Odd.fbt").write_text(
        f'<FBType Name="Odd"><InterfaceList><EventInputs><Event Name="REQ"/></EventInputs>{head}</InterfaceList>'
        f'<SimpleFB>{rest}<Algorithm Name="REQ"><ST/></Algorithm></SimpleFB></FBType>'
    )
    (tmp_path / "Lamp.dtp").write_text(
        '<DataType Name="Lamp"><EnumeratedType InitialValue="OFF"><EnumeratedValue Name="OFF"/>'
        '<EnumeratedValue Name="ON"/></EnumeratedType></DataType>'
    )
    made = network("A: Odd", "", "", {})
    with pytest.raises(FunctionBlockError, match=f"Odd.*C: {what}.* is not supported"):
        unit_of(network_layout(made, Library([tmp_path])), "odd")
