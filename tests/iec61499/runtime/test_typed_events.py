"""E_TRIG triggers the events of a type that nothing is connected to."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.runtime.linking.linker import link
from iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import network

COUNTER = """<FBType Name="STARTED"><InterfaceList>
<EventInputs><Event Name="INIT" Type="EInit"/><Event Name="REQ" Type="Event"/></EventInputs>
<EventOutputs><Event Name="INITO" Type="EInit"><With Var="N"/></Event></EventOutputs>
<OutputVars><VarDeclaration Name="N" Type="UINT"/></OutputVars></InterfaceList>
<BasicFB><ECC><ECState Name="IDLE"/><ECState Name="COUNTED"><ECAction Algorithm="COUNT" Output="INITO"/></ECState>
<ECTransition Source="IDLE" Destination="COUNTED" Condition="INIT"/>
<ECTransition Source="COUNTED" Destination="IDLE" Condition="1"/></ECC>
<Algorithm Name="COUNT"><ST>N := N + 1;</ST></Algorithm></BasicFB></FBType>"""
AROUND = """<FBType Name="AROUND">
<InterfaceList><EventInputs><Event Name="GO" Type="Event"/></EventInputs></InterfaceList>
<FBNetwork><FB Name="INNER" Type="STARTED"/></FBNetwork></FBType>"""


@pytest.fixture
def library(tmp_path: Path) -> Library:
    (tmp_path / "STARTED.fbt").write_text(COUNTER)
    (tmp_path / "AROUND.fbt").write_text(AROUND)
    return Library([tmp_path])


def test_inputs_of_the_type_that_nothing_is_connected_to_get_the_event(library: Library) -> None:
    made = network(
        "START: E_RESTART; T: E_TRIG; A: STARTED; B: STARTED; C: AROUND; LAST: E_CTU",
        "START.COLD -> T.REQ; T.CNF -> LAST.CU; A.INITO -> B.INIT",
        parameters={"LAST.PV": "9"},
    )
    resource = Resource(made, library)
    resource.start()
    assert [resource.read(name) for name in ("A.N", "B.N", "C.INNER.N", "LAST.CV")] == [1, 1, 0, 1]


@pytest.mark.parametrize("kind", ["SERVER_0_1", "CLIENT_1_0", "PUBLISH_1", "SUBSCRIBE_1", "PUBL_1", "IX"])
def test_services_are_initialised_by_the_event_of_that_type(kind: str) -> None:
    made = network(f"START: E_RESTART; T: E_TRIG; S: {kind}; N: E_CTU", "START.COLD -> T.REQ; S.INITO -> N.CU")
    found = link(made, Library().find)
    assert [port.name for port in (wire.destination for wire in found.events)] == ["INIT", "REQ", "CU"]


def test_other_types_are_triggered_by_their_name(library: Library) -> None:
    made = network("T: E_TRIG; A: STARTED", "", parameters={"T.EVENTTYPE": "'Event'"})
    resource = Resource(made, library)
    resource.trigger("T.REQ")
    resource.run_until_idle()
    assert resource.read("A.N") == 0


def test_the_type_is_a_literal(library: Library) -> None:
    made = network("T: E_TRIG; S: STRING2STRING", "", "S.OUT -> T.EVENTTYPE")
    with pytest.raises(FunctionBlockError, match=r"T\.EVENTTYPE is connected: expected a literal such as 'EInit'"):
        Resource(made, library)
