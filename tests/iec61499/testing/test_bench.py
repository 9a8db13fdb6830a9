"""Blocks and systems on a bench, on every runtime that is here."""

from __future__ import annotations

from pathlib import Path

import pytest

from iec61499.errors import FunctionBlockError
from iec61499.testing import block, session, system
from tests.support.iec61499.c_harness import needs_compiler
from tests.support.iec61499.counter import write_counter
from tests.support.iec61499.served_device import ServedDevice

PLUG = """<AdapterType Name="ASK"><InterfaceList>
<EventInputs><Event Name="ANSWER"><With Var="GOT"/></Event></EventInputs>
<EventOutputs><Event Name="QUESTION"><With Var="WANTED"/></Event></EventOutputs>
<InputVars><VarDeclaration Name="GOT" Type="INT"/></InputVars>
<OutputVars><VarDeclaration Name="WANTED" Type="INT"/></OutputVars>
</InterfaceList></AdapterType>"""
ASKED = """<FBType Name="ASKED"><InterfaceList>
<EventOutputs><Event Name="DONE"/></EventOutputs>
<Sockets><AdapterDeclaration Name="DOOR" Type="ASK"/></Sockets></InterfaceList>
<BasicFB><ECC><ECState Name="WAIT"/><ECState Name="ASKED">
<ECAction Algorithm="ANSWER" Output="DOOR.ANSWER"/><ECAction Output="DONE"/></ECState>
<ECTransition Source="WAIT" Destination="ASKED" Condition="DOOR.QUESTION"/></ECC>
<Algorithm Name="ANSWER"><ST>DOOR.GOT := DOOR.WANTED + 1;</ST></Algorithm></BasicFB></FBType>"""
PAIR = """<FBType Name="PAIR"><InterfaceList>
<EventInputs><Event Name="GO"/></EventInputs><EventOutputs><Event Name="DONE"/></EventOutputs></InterfaceList>
<FBNetwork><FB Name="LATER" Type="E_DELAY"><Parameter Name="DT" Value="T#2s"/></FB>
<FB Name="COUNTER" Type="COUNTER"/>
<EventConnections><Connection Source="GO" Destination="LATER.START"/>
<Connection Source="LATER.EO" Destination="COUNTER.CU"/>
<Connection Source="COUNTER.CUO" Destination="DONE"/></EventConnections></FBNetwork></FBType>"""
TWO = """<System Name="two"><Application Name="A"><SubAppNetwork>
<FB Name="CLOCK" Type="E_CYCLE"><Parameter Name="DT" Value="T#1s"/></FB><FB Name="COUNTER" Type="COUNTER"/>
<EventConnections><Connection Source="CLOCK.EO" Destination="COUNTER.CU"/></EventConnections>
</SubAppNetwork></Application>
<Device Name="D" Type="FORTE_PC"><Resource Name="ONE" Type="EMB_RES"><FBNetwork><EventConnections>
<Connection Source="START.COLD" Destination="A.CLOCK.START"/></EventConnections></FBNetwork></Resource>
<Resource Name="TWO" Type="EMB_RES"/></Device>
<Mapping From="A.CLOCK" To="D.ONE"/><Mapping From="A.COUNTER" To="D.TWO"/></System>"""


def test_events_are_functions_and_variables_attributes(tmp_path: Path) -> None:
    write_counter(tmp_path)
    counter = block("COUNTER", tmp_path)
    assert counter.CU(R=False) == ("CUO",)
    assert (counter.CV, counter.Q, counter.state) == (1, False, "START")
    counter.PV = 1
    counter.CU()
    assert (counter.CV, counter.Q, counter.CUO) == (2, True, 1)
    assert counter.issued == (("CUO", {"CV": 2, "Q": True}),)
    counter["R"] = "TRUE"
    assert counter.fire("CU") == ("CUO",)
    assert counter["CV"] == 0


@needs_compiler
def test_machine_code_gives_the_same_events(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "current", session.Session("native"))
    write_counter(tmp_path)
    counter = block("COUNTER", tmp_path, PV=1)
    assert counter.CU(R=False) == ("CUO",)
    assert counter.issued == (("CUO", {"CV": 1, "Q": True}),)
    assert counter.state == "START"


def test_a_device_by_its_address_gives_the_same_events(
    tmp_path: Path, served: ServedDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "current", session.Session(str(served.management.address)))
    doubler = block("DOUBLER", tmp_path, X=1.5)
    assert doubler.REQ() == ("CNF",)
    assert doubler.issued == (("CNF", {"Y": 3.0}),)
    assert doubler.REQ(X=4.0) == ("CNF",)
    assert doubler.Y == 8.0
    session.current.close()


def test_ports_of_adapters_are_reached_behind_their_names(tmp_path: Path) -> None:
    (tmp_path / "ASK.adp").write_text(PLUG)
    (tmp_path / "ASKED.fbt").write_text(ASKED)
    asked = block("ASKED", tmp_path)
    assert asked.DOOR.QUESTION(**{"DOOR.WANTED": 41}) == ("DOOR.ANSWER", "DONE")
    assert asked.DOOR.GOT == 42
    asked.DOOR.WANTED = 1
    assert asked.DOOR.WANTED == 1


def test_a_composite_goes_on_in_simulated_time_and_can_be_looked_into(tmp_path: Path) -> None:
    write_counter(tmp_path)
    (tmp_path / "PAIR.fbt").write_text(PAIR)
    pair = block("PAIR", tmp_path)
    assert pair.GO() == ()
    assert pair.due() == 2.0
    assert pair.advance("T#1s") == ()
    assert pair.advance(1) == ("DONE",)
    assert pair.COUNTER.CV == 1


def test_whole_systems_run_with_one_clock(tmp_path: Path) -> None:
    write_counter(tmp_path)
    (tmp_path / "two.sys").write_text(TWO)
    plant = system(tmp_path / "two.sys")
    plant.advance("T#3s")
    assert plant["COUNTER.CV"] == 3
    plant["D.TWO.COUNTER.R"] = True
    plant.trigger("COUNTER.CU")
    assert (plant["COUNTER.CV"], plant.time) == (0, 3.0)


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    write_counter(tmp_path)
    counter = block("COUNTER", tmp_path)
    with pytest.raises(AttributeError, match="COUNTER has no port 'CUU': expected CU"):
        _ = counter.CUU
    with pytest.raises(FunctionBlockError, match="COUNTER has no input 'PW': expected PV"):
        counter.CU(PW=1)
    with pytest.raises(FunctionBlockError, match=r"expected a value of INT, got 1\.5"):
        counter.CU(PV=1.5)
    with pytest.raises(FunctionBlockError, match="expected -32768 to 32767"):
        counter.PV = 40_000
