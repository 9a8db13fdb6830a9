"""Structures, dates, bounded strings, constants of namespaces."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.runtime.resource import Resource
from iec61499.types import StructType
from tests.support.iec61499.networks import network

POINT = """<DataType Name="Point"><StructuredType>
  <VarDeclaration Name="X" Type="INT" InitialValue="3"/>
  <VarDeclaration Name="TAG" Type="STRING[4]" InitialValue="'ab'"/>
</StructuredType></DataType>"""
LINE = """<DataType Name="Line"><StructuredType>
  <VarDeclaration Name="ENDS" Type="Point" ArraySize="2"/>
  <VarDeclaration Name="SINCE" Type="DATE_AND_TIME" InitialValue="DT#2024-02-29-12:00:00"/>
</StructuredType></DataType>"""
LIMITS = """<GlobalConstants Name="limits"><GlobalConstants>
  <VarDeclaration Name="TOP" Type="INT" InitialValue="42"/>
</GlobalConstants></GlobalConstants>"""
DRAWER = """<FBType Name="Drawer"><InterfaceList>
  <EventInputs><Event Name="REQ"><With Var="L"/></Event></EventInputs>
  <EventOutputs><Event Name="CNF"><With Var="OUT"/><With Var="N"/></Event></EventOutputs>
  <InputVars><VarDeclaration Name="L" Type="Line"/>
  <VarDeclaration Name="P" Type="INT" InitialValue="my::limits::TOP"/></InputVars>
  <OutputVars><VarDeclaration Name="OUT" Type="Line"/><VarDeclaration Name="N" Type="INT"/>
  <VarDeclaration Name="LATER" Type="DT"/></OutputVars>
</InterfaceList><SimpleFB><Algorithm Name="REQ"><ST><![CDATA[
VAR Q: Point; END_VAR
OUT := L;
Q := L.ENDS[0];
Q.X := Q.X + limits::TOP;
Q.TAG := 'abcdefgh';
OUT.ENDS[1] := Q;
CASE OUT.ENDS[1].X OF limits::TOP: N := 1; 45: N := 2; END_CASE;
LATER := L.SINCE + T#1d;
]]></ST></Algorithm></SimpleFB></FBType>"""


@pytest.fixture
def library(tmp_path: Path) -> Library:
    for name, text in (("Point.dtp", POINT), ("Line.dtp", LINE), ("limits.gcf", LIMITS), ("Drawer.fbt", DRAWER)):
        (tmp_path / name).write_text(text)
    return Library([tmp_path])


def test_structures_are_values(library: Library) -> None:
    made = network("START: E_RESTART; A: Drawer; B: Drawer", "START.COLD -> A.REQ; A.CNF -> B.REQ", "A.OUT -> B.L")
    resource = Resource(made, library)
    resource.start()
    since = resource.read("A.L")[1]
    assert resource.read("A.OUT") == [[[3, "ab"], [45, "abcd"]], since]
    assert resource.read("A.L") == [[[3, "ab"], [3, "ab"]], since]
    assert resource.read("B.L") == resource.read("A.OUT")
    assert (resource.read("A.N"), resource.read("A.P")) == (2, 42)
    assert resource.read("A.LATER") - since == 86_400_000_000_000
    resource.write("A.L", [[[1, "x"], [2, "y"]], 0])
    with pytest.raises(FunctionBlockError, match=r"A\.L\.ENDS: expected 2 values"):
        resource.write("A.L", [[[1, "x"]], 0])


def test_structure_blocks_take_apart_and_put_together(library: Library) -> None:
    made = network(
        "START: E_RESTART; M: STRUCT_MUX_1Point; D: STRUCT_DEMUX_1Point",
        "START.COLD -> M.REQ; M.CNF -> D.REQ",
        "M.OUT -> D.IN",
        {"M.X": "9", "M.TAG": "'q'"},
    )
    resource = Resource(made, library)
    resource.start()
    assert (resource.read("D.X"), resource.read("D.TAG")) == (9, "q")


def test_a_structure_that_contains_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "Line.dtp").write_text(LINE)
    (tmp_path / "Point.dtp").write_text(POINT.replace('"INT" InitialValue="3"', '"Line"'))
    with pytest.raises(FunctionBlockError, match="contains itself: Line -> Point -> Line"):
        Library([tmp_path]).data_type("Line")


def test_a_structure_counts_its_elements(tmp_path: Path) -> None:
    (tmp_path / "Line.dtp").write_text(LINE.replace('ArraySize="2"', 'ArraySize="40000"'))
    (tmp_path / "Point.dtp").write_text(POINT)
    with pytest.raises(FunctionBlockError, match="of 80000 elements: expected at most 65535"):
        Library([tmp_path]).data_type("Line")


def test_unknown_members_and_constants_are_named(library: Library, tmp_path: Path) -> None:
    assert isinstance(library.data_type("pkg::Line"), StructType)
    for wrong, message in (
        ("OUT.ENDS[1].Z := 1;", "Point has no member Z: expected X or TAG"),
        ("N := limits::BOTTOM;", "unknown constant limits::BOTTOM"),
        ("N := OUT.SINCE.X;", "has no member X"),
    ):
        text = DRAWER.replace("OUT := L;", wrong)
        (tmp_path / "Drawer.fbt").write_text(text)
        with pytest.raises(FunctionBlockError) as caught:
            Resource(network("A: Drawer"), Library([tmp_path]))
        assert message in str(caught.value)
        assert "Drawer.fbt:" in str(caught.value)
