"""Adapters: plugs and sockets in basic, composite and subapplication types."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.deploy.plan import plan_deployment
from iec61499.library import Library
from iec61499.model import Connection
from iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import network

ADAPTER = """<AdapterType Name="Valve"><InterfaceList>
  <EventInputs><Event Name="DONE"><With Var="FLOW"/></Event></EventInputs>
  <EventOutputs><Event Name="OPEN"><With Var="HOW"/></Event></EventOutputs>
  <InputVars><VarDeclaration Name="FLOW" Type="INT"/></InputVars>
  <OutputVars><VarDeclaration Name="HOW" Type="INT" InitialValue="7"/></OutputVars>
</InterfaceList></AdapterType>"""
MASTER = """<FBType Name="Master"><InterfaceList>
  <EventInputs><Event Name="GO"><With Var="X"/></Event></EventInputs>
  <EventOutputs><Event Name="OK"><With Var="Y"/></Event></EventOutputs>
  <InputVars><VarDeclaration Name="X" Type="INT"/></InputVars>
  <OutputVars><VarDeclaration Name="Y" Type="INT"/></OutputVars>
  <Plugs><AdapterDeclaration Name="valve" Type="Valve"/></Plugs>
</InterfaceList><BasicFB><ECC>
  <ECState Name="START"/>
  <ECState Name="ASK"><ECAction Algorithm="ASK" Output="valve.OPEN"/></ECState>
  <ECState Name="TOLD"><ECAction Algorithm="TOLD" Output="OK"/></ECState>
  <ECTransition Source="START" Destination="ASK" Condition="GO[X &gt; 0 AND valve.FLOW = 0]"/>
  <ECTransition Source="ASK" Destination="TOLD" Condition="valve.DONE"/>
  <ECTransition Source="TOLD" Destination="START" Condition="1"/>
</ECC>
<Algorithm Name="ASK"><ST><![CDATA[VALVE.HOW := X + 1;]]></ST></Algorithm>
<Algorithm Name="TOLD"><ST><![CDATA[Y := valve.FLOW;]]></ST></Algorithm>
</BasicFB></FBType>"""
SERVANT = """<FBType Name="Servant"><InterfaceList>
  <Sockets><AdapterDeclaration Name="S" Type="Valve"/></Sockets>
</InterfaceList><BasicFB><ECC>
  <ECState Name="START"/>
  <ECState Name="DO"><ECAction Algorithm="DO" Output="S.DONE"/></ECState>
  <ECTransition Source="START" Destination="DO" Condition="S.OPEN"/>
  <ECTransition Source="DO" Destination="START" Condition="1"/>
</ECC><Algorithm Name="DO"><ST><![CDATA[S.FLOW := S.HOW * 10;]]></ST></Algorithm></BasicFB></FBType>"""
WRAPPED = """<FBType Name="Wrapped"><InterfaceList>
  <Sockets><AdapterDeclaration Name="IN" Type="Valve"/></Sockets>
</InterfaceList><FBNetwork><FB Name="INNER" Type="Servant"/>
  <AdapterConnections><Connection Source="IN" Destination="INNER.S"/></AdapterConnections>
</FBNetwork></FBType>"""
PASSED = """<SubAppType Name="Passed"><SubAppInterfaceList>
  <Sockets><AdapterDeclaration Name="IN" Type="Valve"/></Sockets>
</SubAppInterfaceList><SubAppNetwork><FB Name="INNER" Type="Wrapped"/>
  <AdapterConnections><Connection Source="IN" Destination="INNER.IN"/></AdapterConnections>
</SubAppNetwork></SubAppType>"""
BY_EVENTS = """<FBType Name="ByEvents"><InterfaceList>
  <Sockets><AdapterDeclaration Name="S" Type="Valve"/></Sockets>
</InterfaceList><FBNetwork><FB Name="F" Type="F_ADD"><Parameter Name="IN2" Value="INT#1000"/></FB>
  <EventConnections><Connection Source="S.OPEN" Destination="F.REQ"/>
  <Connection Source="F.CNF" Destination="S.DONE"/></EventConnections>
  <DataConnections><Connection Source="S.HOW" Destination="F.IN1"/>
  <Connection Source="F.OUT" Destination="S.FLOW"/></DataConnections>
</FBNetwork></FBType>"""


@pytest.fixture
def library(tmp_path: Path) -> Library:
    (tmp_path / "Valve.ADP").write_text(ADAPTER)
    types = {"Master": MASTER, "Servant": SERVANT, "Wrapped": WRAPPED, "ByEvents": BY_EVENTS}
    for name, text in types.items():
        (tmp_path / f"{name}.fbt").write_text(text)
    (tmp_path / "Passed.sub").write_text(PASSED)
    return Library([tmp_path])


def system(library: Library, servant: str, *adapters: tuple[str, str]) -> Resource:
    made = network(
        f"START: E_RESTART; M: Master; V: {servant}; W: Servant", "START.COLD -> M.GO", parameters={"M.X": "4"}
    )
    connections = tuple(Connection(source, destination, line=1) for source, destination in adapters)
    return Resource(replace(made, adapters=connections, file="a.sys"), library)


@pytest.mark.parametrize(
    ("servant", "socket", "flow"),
    [("Servant", "S", 50), ("Wrapped", "IN", 50), ("Passed", "IN", 50), ("ByEvents", "S", 1005)],
)
def test_a_request_crosses_the_adapter_and_the_answer_comes_back(
    library: Library, servant: str, socket: str, flow: int
) -> None:
    resource = system(library, servant, ("M.valve", f"V.{socket}"))
    resource.start()
    assert (resource.read("M.valve.HOW"), resource.read("M.Y")) == (5, flow)
    assert resource.read("M.$ECC") == "START"


def test_an_adapter_that_is_not_connected_waits(library: Library) -> None:
    resource = system(library, "Servant")
    resource.start()
    assert (resource.read("M.$ECC"), resource.read("V.S.HOW")) == ("ASK", 7)


@pytest.mark.parametrize(
    ("adapters", "message"),
    [
        ([("M.valve", "V.T")], "a.sys:1: connection M.valve -> V.T: V has no adapter T: expected S"),
        ([("M.valve", "X.S")], "unknown block X"),
        ([("M.valve", "V.S"), ("M.valve", "W.S")], "M.valve is connected in line 1"),
    ],
)
def test_wrong_adapter_connections_are_named(library: Library, adapters: list[tuple[str, str]], message: str) -> None:
    with pytest.raises(FunctionBlockError) as caught:
        system(library, "Servant", *adapters)
    assert message in str(caught.value)


def test_time_outs_come_from_the_standard_blocks() -> None:
    resource = Resource(network("START: E_RESTART; T: E_TimeOut; U: E_RTimeOut"), Library())
    resource.start()
    assert resource.read("T.TimeOutSocket.DT") == resource.read("U.TimeOutSocket.DT") == 0


@pytest.mark.parametrize("kind", ["Servant", "Wrapped", "E_TimeOut"])
def test_a_block_with_adapters_is_not_deployed(library: Library, kind: str) -> None:
    with pytest.raises(FunctionBlockError, match=f"block B: adapter .* of {kind} cannot be deployed"):
        plan_deployment("RES", network(f"START: E_RESTART; B: {kind}"), library)


def test_connections_of_adapters_may_stand_among_those_of_data(tmp_path: Path) -> None:
    for name, text in (("Valve.adp", ADAPTER), ("Master.fbt", MASTER), ("Servant.fbt", SERVANT)):
        (tmp_path / name).write_text(text)
    resource = Resource(network("M: Master; S: Servant", "", "M.valve -> S.S", {"M.X": "4"}), Library([tmp_path]))
    resource.trigger("M.GO")
    resource.run_until_idle()
    assert (resource.read("S.S.HOW"), resource.read("M.Y")) == (5, 50)
