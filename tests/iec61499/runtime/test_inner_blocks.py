"""Blocks inside basic and simple blocks."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.deploy.lua_export import export_type
from iec61499.inspection import inspect
from iec61499.library import Library
from iec61499.model import SimpleFBType
from iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import network
from tests.support.iec61499.served_device import ANY_PORT, ServedDevice, build, wait_for

GAIN = """<FBType Name="Gain"><InterfaceList>
  <EventInputs><Event Name="REQ"><With Var="IN"/></Event></EventInputs>
  <EventOutputs><Event Name="CNF"><With Var="OUT"/></Event></EventOutputs>
  <InputVars><VarDeclaration Name="IN" Type="INT"/><VarDeclaration Name="K" Type="INT" InitialValue="2"/></InputVars>
  <OutputVars><VarDeclaration Name="OUT" Type="INT"/></OutputVars>
</InterfaceList><SimpleFB><Algorithm Name="REQ"><ST>OUT := K * IN;</ST></Algorithm></SimpleFB></FBType>"""
TOGGLE = """<FBType Name="Toggle"><InterfaceList>
  <EventInputs><Event Name="GO"/><Event Name="RST"/></EventInputs>
  <EventOutputs><Event Name="EO"/></EventOutputs>
  <OutputVars><VarDeclaration Name="COUNT" Type="INT"/><VarDeclaration Name="SEEN" Type="INT"/></OutputVars>
  <InOutVars><VarDeclaration Name="SUM" Type="INT"/></InOutVars>
</InterfaceList><BasicFB>
  <InternalVars><FB Name="triple" Type="Gain"><Parameter Name="K" Value="3"/></FB></InternalVars>
  <ECC><ECState Name="OFF"/><ECState Name="ON"><ECAction Algorithm="COUNTING" Output="EO"/></ECState>
    <ECState Name="ZERO"><ECAction Algorithm="RESET"/></ECState>
    <ECTransition Source="OFF" Destination="ON" Condition="GO[COUNT &lt; 2]"/>
    <ECTransition Source="ON" Destination="OFF" Condition="1"/>
    <ECTransition Source="OFF" Destination="ZERO" Condition="RST"/>
    <ECTransition Source="ZERO" Destination="OFF" Condition="1"/>
  </ECC>
  <Algorithm Name="COUNTING"><ST>
    COUNT := COUNT + 1; triple(IN := COUNT, OUT => SEEN); SUM := SUM + SEEN;</ST></Algorithm>
  <Algorithm Name="RESET"><ST>COUNT := 0;</ST></Algorithm>
</BasicFB></FBType>"""
USER = """<FBType Name="User"><InterfaceList>
  <EventInputs><Event Name="REQ"><With Var="N"/></Event></EventInputs>
  <EventOutputs><Event Name="CNF"><With Var="Y"/></Event></EventOutputs>
  <InputVars><VarDeclaration Name="N" Type="INT"/></InputVars>
  <OutputVars><VarDeclaration Name="Y" Type="INT" ArraySize="3"/>
  <VarDeclaration Name="LATE" Type="BOOL"/></OutputVars>
</InterfaceList><SimpleFB>
  <InternalVars><FB Name="g" Type="Gain"/><FB Name="t" Type="lib::Toggle"/><FB Name="timer" Type="FB_TON"/>
    <VarDeclaration Name="TOTAL" Type="INT"/></InternalVars>
  <Algorithm Name="REQ"><ST><![CDATA[%s]]></ST></Algorithm>
</SimpleFB></FBType>"""
BODY = """
VAR i : INT; END_VAR
g.K := 5;
FOR i := 0 TO 2 DO
  g.REQ(IN := N + i, OUT => Y[i]);
END_FOR;
t.GO(SUM := TOTAL); t.go(SUM := TOTAL); t(SUM := TOTAL);
IF t.COUNT = 2 THEN t.RST(); END_IF;
timer(IN := TRUE, PT := T#1s, Q => LATE);
IF LATE THEN RETURN; END_IF;
Y[2] := Y[2] + 1 / (N - 7);
"""


def library(folder: Path, body: str = BODY) -> Library:
    for name, text in (("Gain", GAIN), ("Toggle", TOGGLE), ("User", USER % body)):
        (folder / f"{name}.fbt").write_text(text)
    return Library([folder])


def test_they_react_in_the_middle_of_an_algorithm(tmp_path: Path) -> None:
    resource = Resource(
        network("START: E_RESTART; A: User", "START.COLD -> A.REQ", "", {"A.N": "7"}), library(tmp_path)
    )
    resource.start()
    assert resource.read("A.Y") == [35, 40, 45]
    # the third GO finds COUNT = 2; 3 * 1 and 3 * 2 went through the VAR_IN_OUT
    assert (resource.read("A.TOTAL"), resource.read("A.t.COUNT"), resource.read("A.t.SEEN")) == (9, 0, 6)
    assert resource.read("A.t.triple.IN") == 2
    assert resource.read("A.LATE") is False
    resource.advance(2_000_000_000)
    resource.trigger("A.REQ")
    resource.run_until_idle()
    assert (resource.read("A.TOTAL"), resource.read("A.LATE")) == (18, True)


def test_their_state_is_that_of_the_block_around(tmp_path: Path) -> None:
    made = network("START: E_RESTART; A: User; B: User", "START.COLD -> A.REQ", "", {"A.N": "7"})
    resource = Resource(made, library(tmp_path, "t.GO(); g(IN := N); Y[0] := t.COUNT;"))
    resource.start()
    before = resource.snapshot()
    for count in (2, 2):
        resource.trigger("A.REQ")
        resource.run_until_idle()
        assert resource.read("A.Y") == [count, 0, 0]
    assert (resource.read("A.g.OUT"), resource.read("B.g.OUT"), resource.read("B.t.COUNT")) == (14, 0, 0)
    resource.restore(before)
    assert (resource.read("A.t.COUNT"), resource.read("A.Y")) == (1, [1, 0, 0])


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("x();", "unknown block x: expected g, t or timer"),
        ("g.NOW();", "g has no such event input: expected REQ"),
        ("g(WRONG := 1);", "g has no input WRONG: expected IN or K"),
        ("g(IN => Y[0]);", "g has no output IN: expected OUT"),
        ("g(IN := TRUE);", "BOOL does not fit INT"),
        ("g.OUT := 1;", "g.OUT cannot be assigned here"),
        ("Y[0] := t.triple.IN;", "unknown variable t"),
        ("t(SUM := 1);", "SUM of t gives a value back: expected a variable"),
        ("Y[0] := g(1);", "unknown function G"),
    ],
)
def test_errors_name_the_line_and_what_is_there(tmp_path: Path, body: str, message: str) -> None:
    known = library(tmp_path, body)
    with pytest.raises(FunctionBlockError, match=re.escape(message)) as caught:
        Resource(network("A: User", ""), known)
    assert (Path(caught.value.file).name, caught.value.line) == ("User.fbt", 10)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("User", "User contains itself: User -> User"),
        ("F_ADD", "F_ADD inside a basic or simple block: IN1 is ANY_MAGNITUDE, which no connection tells there"),
        ("E_TRAIN", "inside a basic or simple block is a"),
        ("E_DELAY", "E_DELAY inside a basic or simple block is a service"),
        ("Nothing", "unknown block type Nothing"),
    ],
)
def test_what_cannot_stand_inside_is_named(tmp_path: Path, kind: str, message: str) -> None:
    (tmp_path / "User.fbt").write_text(USER.replace("lib::Toggle", kind).replace("FB_TON", "FB_TOF") % "")
    (tmp_path / "Gain.fbt").write_text(GAIN)
    with pytest.raises(FunctionBlockError, match=re.escape(message)) as caught:
        Resource(network("A: User", ""), Library([tmp_path]))
    assert (Path(caught.value.file or "User.fbt").name, caught.value.line or 8) == ("User.fbt", 8)


def test_a_check_names_what_cannot_stand_inside(tmp_path: Path) -> None:
    file = tmp_path / "User.fbt"
    file.write_text(USER.replace("lib::Toggle", "E_DELAY") % "")
    (tmp_path / "Gain.fbt").write_text(GAIN)
    (problem,) = inspect(file, Library([tmp_path])).problems
    assert "E_DELAY inside a basic or simple block is a service" in problem.message
    assert problem.line == 8


def test_a_device_tells_their_variables(tmp_path: Path) -> None:
    device = ServedDevice(library(tmp_path), ANY_PORT)
    device.start()
    try:
        with device.client() as client:
            build(client, "R", "A User N=7\nSTART.COLD -> A.REQ")
            client.start("R")
            wait_for(client, "R", "A.t.triple.IN", lambda value: value == "2")
    finally:
        device.stop()


def test_lua_has_none(tmp_path: Path) -> None:
    block = library(tmp_path).find("User")
    assert isinstance(block, SimpleFBType)
    with pytest.raises(FunctionBlockError, match="block g inside User is not available in Lua") as caught:
        export_type(block)
    assert caught.value.line == 8
