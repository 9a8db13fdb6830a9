"""Enumerations: values, in Structured Text, on the wire."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dtwin.errors import CommunicationError, FunctionBlockError
from iec61499.deploy.lua_export import export_type
from iec61499.library import Library
from iec61499.literals import format_literal, parse_literal
from iec61499.model import SimpleFBType
from iec61499.net.wire import MessageReader, Signature
from iec61499.runtime.resource import Resource
from iec61499.types import ArrayType, enumeration
from tests.support.iec61499.networks import network

COLOUR = enumeration("Colour", ("RED", "GREEN", "BLUE"), 1)
FILES = {
    "Colour.dtp": """<DataType Name="Colour"><EnumeratedType InitialValue="Colour#GREEN">
  <EnumeratedValue Name="RED"/><EnumeratedValue Name="GREEN" Comment="go"/><EnumeratedValue Name="BLUE"/>
</EnumeratedType></DataType>""",
    "Mood.dtp": """<DataType Name="Mood"><EnumeratedType>
  <EnumeratedValue Name="BLUE"/><EnumeratedValue Name="MERRY"/>
</EnumeratedType></DataType>""",
    "Box.dtp": """<DataType Name="Box"><StructuredType>
  <VarDeclaration Name="LID" Type="Colour" InitialValue="BLUE"/><VarDeclaration Name="M" Type="pack::Mood"/>
</StructuredType></DataType>""",
}
PAINTER = """<FBType Name="Painter"><InterfaceList>
  <EventInputs><Event Name="REQ"><With Var="C"/></Event></EventInputs>
  <EventOutputs><Event Name="CNF"><With Var="NEXT"/></Event></EventOutputs>
  <InputVars><VarDeclaration Name="C" Type="Colour"/><VarDeclaration Name="B" Type="Box"/></InputVars>
  <OutputVars><VarDeclaration Name="NEXT" Type="Colour"/><VarDeclaration Name="N" Type="INT"/></OutputVars>
</InterfaceList><SimpleFB><Algorithm Name="REQ"><ST><![CDATA[%s]]></ST></Algorithm></SimpleFB></FBType>"""
BODY = """
VAR LAST : Colour := Colour#BLUE; END_VAR
CASE C OF
  RED: NEXT := Colour#GREEN;
  my::Colour#GREEN: NEXT := LAST;
ELSE NEXT := SEL(B.M = Mood#BLUE, RED, c);
END_CASE;
IF NEXT <> Green AND B.LID = Colour#BLUE THEN N := N + 1; END_IF;
"""


def library(folder: Path, body: str = BODY) -> Library:
    for name, text in (*FILES.items(), ("Painter.fbt", PAINTER % body)):
        (folder / name).write_text(text)
    return Library([folder])


def test_values_go_round(tmp_path: Path) -> None:
    made = network("START: E_RESTART; A: Painter; D: Painter", "START.COLD -> A.REQ; A.CNF -> D.REQ", "A.NEXT -> D.C")
    resource = Resource(made, library(tmp_path))
    resource.start()
    assert (resource.read("A.C"), resource.read("A.NEXT"), resource.read("D.NEXT")) == (1, 2, 2)
    assert (resource.read("A.N"), resource.read("D.N")) == (1, 1)
    resource.write("A.C", 0)
    resource.trigger("A.REQ")
    resource.run_until_idle()
    assert (resource.read("A.NEXT"), resource.read("D.NEXT")) == (1, 2)
    with pytest.raises(FunctionBlockError, match="expected 0 to 2 for Colour, got 3"):
        resource.write("A.C", 3)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("NEXT := 1;", "got DINT, expected Colour"),
        ("N := C;", "got Colour, expected INT"),
        ("NEXT := Colour#PINK;", "Colour has no value PINK: expected RED, GREEN or BLUE"),
        ("NEXT := Paint#RED;", "unknown enumeration Paint: expected that of a variable here: Colour or Mood"),
        ("NEXT := BLUE;", "BLUE: expected Colour#BLUE or Mood#BLUE"),
        ("IF C < Colour#BLUE THEN N := 1; END_IF;", "< does not order Colour: expected = or <>"),
        ("IF C = Mood#BLUE THEN N := 1; END_IF;", "= cannot combine Colour and Mood"),
        ("NEXT := C + 1;", "+ cannot combine Colour and DINT"),
        ("RED := C;", "unknown variable RED"),
    ],
)
def test_they_are_no_numbers(tmp_path: Path, body: str, message: str) -> None:
    with pytest.raises(FunctionBlockError, match=re.escape(message)) as caught:
        Resource(network("A: Painter"), library(tmp_path, body))
    assert caught.value.line == 6


@pytest.mark.parametrize(("text", "value"), [("RED", 0), ("green", 1), ("Colour#BLUE", 2), (" pack::COLOUR#RED ", 0)])
def test_literals(text: str, value: int) -> None:
    assert parse_literal(text, COLOUR) == value
    assert parse_literal(format_literal(value, COLOUR), COLOUR) == value


@pytest.mark.parametrize("text", ["PINK", "Mood#RED", "1", "", "#", "Colour#", "9" * 5000])
def test_no_literals(text: str) -> None:
    with pytest.raises(FunctionBlockError, match="expected RED, GREEN or BLUE"):
        parse_literal(text, COLOUR)


def test_they_travel_as_uint() -> None:
    signature = Signature((COLOUR, ArrayType(COLOUR, 0, 1)))
    data = signature.encode([2, [0, 1]])
    assert data == bytes.fromhex("47 0002 76 0002 47 0000 0001")
    assert MessageReader(signature).feed(data) == [(2, [0, 1])]
    with pytest.raises(CommunicationError, match="value 3 of Colour: expected 0 to 2"):
        MessageReader(signature).feed(bytes.fromhex("47 0003"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "enumeration Colour has 0 values: expected 1 to 65535"),
        ('<EnumeratedValue Name="A"/><EnumeratedValue Name="a"/>', "value a is already declared"),
        ('<EnumeratedValue Name="1A"/>', "'1A' is not an identifier"),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "Colour.dtp").write_text(
        f'<DataType Name="Colour">\n<EnumeratedType>{text}</EnumeratedType></DataType>'
    )
    with pytest.raises(FunctionBlockError, match=re.escape(message)) as caught:
        Library([tmp_path]).data_type("Colour")
    assert caught.value.line == 2


def test_lua_has_none(tmp_path: Path) -> None:
    block = library(tmp_path, "N := 1;").find("Painter")
    assert isinstance(block, SimpleFBType)
    with pytest.raises(
        FunctionBlockError, match="enumeration Colour is no type on 4diac FORTE: expected a UINT"
    ) as caught:
        export_type(block)
    assert caught.value.line == 4
