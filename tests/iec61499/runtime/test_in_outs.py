"""VAR_IN_OUT: blocks that are connected one behind the other share one variable."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.deploy.lua_export import export_type
from iec61499.deploy.plan import plan_deployment
from iec61499.library import Library
from iec61499.model import SimpleFBType
from iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import network

ADDER = """<FBType Name="Adder"><InterfaceList>
  <EventInputs><Event Name="REQ"><With Var="N"/><With Var="STORE"/></Event></EventInputs>
  <EventOutputs><Event Name="CNF"><With Var="STORE"/></Event></EventOutputs>
  <InputVars><VarDeclaration Name="N" Type="INT"/></InputVars>
  <InOutVars><VarDeclaration Name="STORE" Type="INT" ArraySize="2" InitialValue="[1, 2]"/></InOutVars>
</InterfaceList><SimpleFB><Algorithm Name="REQ"><ST>STORE[1] := STORE[1] + N;</ST></Algorithm></SimpleFB></FBType>"""
READER = """<FBType Name="Reader"><InterfaceList>
  <EventInputs><Event Name="REQ"><With Var="IN"/></Event></EventInputs>
  <InputVars><VarDeclaration Name="IN" Type="INT" ArraySize="2"/></InputVars>
</InterfaceList><BasicFB><ECC><ECState Name="S"/></ECC></BasicFB></FBType>"""
PAIR = """<FBType Name="Pair"><InterfaceList>
  <EventInputs><Event Name="REQ"><With Var="ALL"/></Event></EventInputs>
  <EventOutputs><Event Name="CNF"><With Var="ALL"/></Event></EventOutputs>
  <InOutVars><VarDeclaration Name="ALL" Type="INT" ArraySize="2"/></InOutVars>
</InterfaceList><FBNetwork>
  <FB Name="X" Type="Adder"><Parameter Name="N" Value="100"/></FB>
  <FB Name="Y" Type="Adder"><Parameter Name="N" Value="1"/></FB>
  <EventConnections><Connection Source="REQ" Destination="X.REQ"/><Connection Source="X.CNF" Destination="Y.REQ"/>
  <Connection Source="Y.CNF" Destination="CNF"/></EventConnections>
  <DataConnections><Connection Source="ALL" Destination="X.STORE"/>
  <Connection Source="X.STORE" Destination="Y.STORE"/>
  <Connection Source="Y.STORE" Destination="ALL"/></DataConnections>
</FBNetwork></FBType>"""


@pytest.fixture
def library(tmp_path: Path) -> Library:
    for name, text in (("Adder", ADDER), ("Reader", READER), ("Pair", PAIR)):
        (tmp_path / f"{name}.fbt").write_text(text)
    return Library([tmp_path])


def test_a_chain_shares_the_first_one(library: Library) -> None:
    made = network(
        "START: E_RESTART; A: Adder; B: Adder; C: Adder; R: Reader",
        "START.COLD -> C.REQ; C.CNF -> A.REQ; A.CNF -> B.REQ; B.CNF -> R.REQ",
        "A.STORE -> B.STORE; B.STORE -> C.STORE; B.STORE -> R.IN",
        {"A.N": "10", "B.N": "100", "C.N": "1000", "A.STORE": "[5, 6]"},
    )
    resource = Resource(made, library)
    resource.start()
    # C runs first, on the variable of A
    assert resource.read("R.IN") == resource.read("A.STORE") == [5, 1116]


def test_one_without_connection_is_a_variable_of_its_own(library: Library) -> None:
    made = network("START: E_RESTART; A: Adder; B: Adder", "START.COLD -> A.REQ; A.CNF -> B.REQ", "", {"A.N": "7"})
    resource = Resource(made, library)
    resource.start()
    assert (resource.read("A.STORE"), resource.read("B.STORE")) == ([1, 9], [1, 2])


def test_through_a_composite(library: Library) -> None:
    made = network(
        "START: E_RESTART; A: Adder; P: Pair; Q: Pair; R: Reader; S: Reader",
        "START.COLD -> P.REQ; P.CNF -> Q.REQ; Q.CNF -> A.REQ; A.CNF -> R.REQ; A.CNF -> S.REQ",
        "A.STORE -> P.ALL; P.ALL -> R.IN; Q.ALL -> S.IN",
        {"A.N": "10"},
    )
    resource = Resource(made, library)
    resource.start()
    assert resource.read("R.IN") == [1, 113]
    assert resource.read("S.IN") == [0, 101]
    snapshot = resource.snapshot()
    resource.trigger("P.REQ")
    resource.run_until_idle()
    assert resource.read("A.STORE")[1] > 113
    resource.restore(snapshot)
    assert resource.read("A.STORE") == [1, 113]


def test_its_source_is_another_one(library: Library) -> None:
    made = network("A: SPLIT; B: Adder", "", "A.OUT -> B.STORE")
    splitter = READER.replace("Reader", "SPLIT").replace('<With Var="IN"/>', "").replace("InputVars", "OutputVars")
    path = Path(library.find("Adder").header.file).with_name("SPLIT.fbt")
    path.write_text(splitter.replace('"IN"', '"OUT"'))
    with pytest.raises(FunctionBlockError, match=re.escape("A.OUT -> B.STORE: a VAR_IN_OUT of ARRAY [0..1] OF INT")):
        Resource(made, Library([path.parent]))


def test_lua_has_none(library: Library) -> None:
    block = library.find("Adder")
    assert isinstance(block, SimpleFBType)
    with pytest.raises(FunctionBlockError, match="VAR_IN_OUT STORE of Adder is not available in Lua") as caught:
        export_type(block)
    assert caught.value.line == 5


def test_a_device_gets_none(library: Library) -> None:
    with pytest.raises(FunctionBlockError, match="block P: VAR_IN_OUT ALL of Pair cannot be deployed"):
        plan_deployment("R", network("P: Pair"), library)
