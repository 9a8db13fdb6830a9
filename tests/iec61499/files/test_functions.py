"""Function types (.fct) of 4diac IDE as blocks, and the functions of its library that are at hand without it."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.deploy.lua_export import export_type
from iec61499.deploy.plan import plan_deployment
from iec61499.inspection import inspect
from iec61499.library import Library
from iec61499.management.protocol import ManagedBlock
from iec61499.mapping import resource_network
from iec61499.model import SimpleFBType
from iec61499.native.layout import network_layout
from iec61499.native.unit import unit_of
from iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import network

TOTAL = """PACKAGE plant;
IMPORT plant::RATES::STEP;
(* FUNCTION NOTHING : INT is only a comment *)
FUNCTION TOTAL : INT // FUNCTION NOR_THIS
VAR_INPUT
    N : INT;
END_VAR
VAR_TEMP
    i : INT;
END_VAR
VAR_OUTPUT
    LAST : ARRAY [0..1] OF INT; // it says END_FUNCTION
END_VAR
FOR i := 1 TO N DO
    TOTAL := TOTAL + STEP + FACTOR;
    LAST[i MOD 2] := i;
END_FOR;
END_FUNCTION
(* what follows does not count *)
"""
FILE = """<Function Name="TOTAL"><CompilerInfo packageName="plant"/><InterfaceList>
<EventInputs><Event Name="REQ"><With Var="N"/></Event></EventInputs>
<EventOutputs><Event Name="CNF"><With Var=""/><With Var="LAST"/></Event></EventOutputs>
<InputVars><VarDeclaration Name="N" Type="INT"/></InputVars>
<OutputVars><VarDeclaration Name="" Type="INT"/><VarDeclaration Name="LAST" Type="INT" ArraySize="2"/></OutputVars>
</InterfaceList><FunctionBody><ST><![CDATA[{text}]]></ST></FunctionBody></Function>"""
RATES = """<GlobalConstants Name="RATES"><CompilerInfo packageName="plant"/><GlobalConstants>
<VarDeclaration Name="STEP" Type="INT" InitialValue="10"/>
<VarDeclaration Name="FACTOR" Type="INT" InitialValue="3"/></GlobalConstants></GlobalConstants>"""
SYSTEM = """<System Name="S"><Application Name="APP"><SubAppNetwork><FB Name="T" Type="plant::TOTAL"/>
<FB Name="C" Type="F_INT_TO_LREAL"/>
<EventConnections><Connection Source="T.CNF" Destination="C.REQ"/></EventConnections>
<DataConnections><Connection Source="T." Destination="C.IN"/></DataConnections></SubAppNetwork></Application>
<Device Name="PC" Type="FORTE_PC"><Resource Name="RES" Type="EMB_RES"/></Device>
<Mapping From="APP.T" To="PC.RES"/><Mapping From="APP.C" To="PC.RES"/></System>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "TOTAL.fct").write_text(FILE.format(text=TOTAL))
    (tmp_path / "RATES.gcf").write_text(RATES)
    (tmp_path / "S.sys").write_text(SYSTEM)
    return tmp_path


def test_a_function_is_a_block_whose_variables_are_new_with_every_call(folder: Path) -> None:
    library = Library([folder])
    resource = Resource(resource_network(library.load_system(folder / "S.sys"), "PC.RES"), library)
    for count, last in ((3, [2, 3]), (1, [0, 1])):
        resource.write("T.N", count)
        resource.trigger("T.REQ")
        resource.run_until_idle()
        assert resource.read("T.TOTAL") == 13 * count
        assert resource.read("T.LAST") == last
        assert resource.read("C.OUT") == 13.0 * count


def test_a_function_is_checked_and_exported_as_other_types_are(folder: Path) -> None:
    library = Library([folder])
    assert inspect(folder / "TOTAL.fct", library).problems == ()
    found = library.find("TOTAL")
    assert isinstance(found, SimpleFBType)
    assert "TOTAL" in export_type(found).name
    assert "TOTAL" in unit_of(network_layout(network("T: TOTAL"), library), "unit").source


def test_an_error_in_a_function_names_its_place(folder: Path) -> None:
    (folder / "TOTAL.fct").write_text(FILE.format(text=TOTAL.replace("+ STEP", "+ WRONG")))
    (problem,) = inspect(folder / "TOTAL.fct", Library([folder])).problems
    lines = (folder / "TOTAL.fct").read_text().splitlines()
    assert lines[problem.line - 1][problem.column - 1 :].startswith("WRONG")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("TOTAL := 1;", "expected one FUNCTION ... END_FUNCTION"),
        (TOTAL + TOTAL, "expected one FUNCTION ... END_FUNCTION"),
        ("FUNCTION TOTAL : INT\nTOTAL := 1;", "expected one FUNCTION ... END_FUNCTION"),
        ("FUNCTION TOTAL : INT\nTOTAL := SCALED(1);\nEND_FUNCTION", "unknown function SCALED"),
    ],
)
def test_what_is_no_function_is_refused(folder: Path, text: str, expected: str) -> None:
    (folder / "TOTAL.fct").write_text(FILE.format(text=text))
    (problem,) = inspect(folder / "TOTAL.fct", Library([folder])).problems
    assert expected in problem.message


def test_a_variable_hides_a_constant_of_its_package(folder: Path) -> None:
    text = TOTAL.replace("i : INT;", "i, FACTOR : INT := 1;")
    (folder / "TOTAL.fct").write_text(FILE.format(text=text))
    resource = Resource(network("T: TOTAL", parameters={"T.N": "2"}), Library([folder]))
    resource.trigger("T.REQ")
    resource.run_until_idle()
    assert resource.read("T.TOTAL") == 22


def test_functions_assemble_and_split_bits() -> None:
    parts = "P: SPLIT_WORD_INTO_QUARTERS; Q: SPLIT_BYTE_INTO_BOOLS; W: ASSEMBLE_WORD_FROM_QUARTERS; L: {}"
    data = "; ".join(f"P.QUARTER_BYTE_{n:02} -> W.QUARTER_BYTE_{n:02}" for n in range(8))
    net = network(parts.format("ASSEMBLE_DWORD_FROM_WORDS"), "P.CNF -> W.REQ; W.CNF -> L.REQ", data)
    resource = Resource(net, Library())
    resource.write("P.IN", 0xA53C)
    resource.write("Q.IN", 0x06)
    resource.write("L.WORD_01", 0x1234)
    for event in ("P.REQ", "Q.REQ"):
        resource.trigger(event)
        resource.run_until_idle()
    assert [resource.read(f"P.QUARTER_BYTE_{n:02}") for n in range(8)] == [0, 3, 3, 0, 1, 1, 2, 2]
    assert [resource.read(f"Q.BIT_{n:02}") for n in range(4)] == [False, True, True, False]
    assert resource.read("W.ASSEMBLE_WORD_FROM_QUARTERS") == 0xA53C
    assert resource.read("L.ASSEMBLE_DWORD_FROM_WORDS") == 0x12340000
    with pytest.raises(FunctionBlockError, match="unknown block type ASSEMBLE_BYTE_FROM_WORDS"):
        Resource(network("L: ASSEMBLE_BYTE_FROM_WORDS"), Library())


def test_a_device_gets_the_functions_that_assemble() -> None:
    planned = plan_deployment("RES", network("A: ASSEMBLE_BYTE_FROM_BOOLS"), Library(), {})
    created = [command.request.subject for command in planned.commands if command.request.action == "CREATE"]
    assert ManagedBlock("A", planned.types[0].name) in created
    with pytest.raises(FunctionBlockError, match="LWORD has 64 bit"):
        plan_deployment("RES", network("A: ASSEMBLE_LWORD_FROM_BOOLS"), Library(), {})


def test_a_typed_integer_at_a_generic_port_may_be_of_a_type_that_it_fits() -> None:
    data = "C.OUT -> A.IN1; A.OUT -> D.IN"
    net = network("C: F_UINT_TO_UDINT; A: F_ADD; D: F_UDINT_TO_UINT", "C.CNF -> A.REQ", data, {"A.IN2": "INT#7"})
    resource = Resource(net, Library())
    resource.write("C.IN", 5)
    resource.trigger("C.REQ")
    resource.run_until_idle()
    assert resource.read("A.OUT") == 12
    wrong = network("C: F_UINT_TO_UDINT; A: F_ADD", "", "C.OUT -> A.IN1", {"A.IN2": "INT#-7"})
    with pytest.raises(FunctionBlockError, match="INT#-7 is a INT, expected UDINT"):
        Resource(wrong, Library())
