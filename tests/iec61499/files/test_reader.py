"""Files of block types: what 4diac IDE writes is read, and errors name file and line."""

from __future__ import annotations

import contextlib
import os
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import FunctionBlockError
from iec61499 import model
from iec61499.files.block_types import read_type, split_condition, type_from_xml
from iec61499.files.xml import parse_xml
from iec61499.library import Library
from iec61499.runtime.resource import Resource
from iec61499.types import INT, LREAL, TIME, ArrayType
from tests.support.iec61499.block_files import BASIC, Write, line_of


def test_basic_block(write: Write) -> None:
    block = read_type(write("SCALE.fbt", BASIC))
    assert isinstance(block, model.BasicFBType)
    header = block.header
    assert (header.name, header.comment, header.standard) == ("SCALE", "Scales", "61499-2")
    assert header.package == "my::package"
    assert header.description == "one\ntwo"
    assert header.versions == (model.Version("1.0", "A", "2024-01-02", "O", "first"),)
    assert block.interface.event_inputs == (model.EventPort("REQ", ("X",), "go", 9),)
    assert [(v.name, v.type, v.initial, v.comment) for v in block.interface.inputs] == [
        ("X", LREAL, "2.5", "m"),
        ("DT", ArrayType(TIME, 0, 3), "", ""),
    ]
    assert (block.internals[0].type, block.internals[0].initial) == (ArrayType(INT, 1, 3), "[1, 2, 3]")
    assert block.states[0] == model.ECState("START", (), 475.0, 1125.5, "Initial", 29)
    assert block.states[1].actions == (model.ECAction("SCALE", "CNF", 30),)
    assert [(t.source, t.event, t.guard, t.destination) for t in block.transitions] == [
        ("START", "REQ", "X > 0.0", "RUN"),
        ("RUN", "", "", "START"),
    ]
    assert block.algorithms[0].source == model.Source("Y := X\n  * K[2];", 35)


def test_simple_block_of_newer_and_older_tools(write: Write) -> None:
    body = """<SimpleFB>
      <ECState Name="REQ"><ECAction Algorithm="A" Output="CNF"/></ECState>
      <Algorithm Name="A"><ST><![CDATA[
ALGORITHM A
Y := X;
END_ALGORITHM
]]></ST></Algorithm></SimpleFB>"""
    basic = BASIC[BASIC.index("  <BasicFB>") : BASIC.index("</BasicFB>") + 10]
    newer = read_type(write("SCALE.fbt", BASIC, (basic, body)))
    assert isinstance(newer, model.SimpleFBType)
    assert newer.algorithms[0].source.exact
    state = re.sub("<ECState.*</ECState>", "", body)
    older = read_type(write("SCALE.fbt", BASIC, (basic, state)))
    assert isinstance(older, model.SimpleFBType)
    assert [(s.name, s.actions[0].algorithm, s.actions[0].output) for s in older.states] == [("REQ", "A", "CNF")]


def test_a_block_without_body_is_known_by_its_interface(write: Write) -> None:
    basic = BASIC[BASIC.index("  <BasicFB>") : BASIC.index("</BasicFB>") + 10]
    path = write("SCALE.fbt", BASIC, (basic, '<Service LeftInterface="A" RightInterface="B"><Any/></Service>'))
    assert isinstance(read_type(path), model.ServiceInterfaceFBType)
    with pytest.raises(FunctionBlockError, match="block type SCALE has an interface but no behaviour"):
        Resource(model.FBNetwork((model.Block("S", "SCALE"),)), Library([path.parent]))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('Name="SCALE">\n  <Id', 'Nme="SCALE">\n  <Id', "<FBType> needs the attribute Name, it has Comment or Nme"),
        ('Name="X" Type', 'Name="1X" Type', "'1X' is not an identifier: expected letters, digits and single _"),
        ('Name="X" Type', 'Name="to__X" Type', "'to__X' is not an identifier: expected letters, digits and single _"),
        ('Name="Y" Type', 'Name="x" Type', "unknown output variable Y in WITH of CNF: expected x"),
        ('Name="DT" Type', 'Name="y" Type', "port Y is already declared in line 18"),
        ('Name="K"', 'Name="Y"', "variable Y is already declared in line 21"),
        ('Type="LREAL"/>', 'Type="COLOUR"/>', "variable X: unknown type 'COLOUR': expected BOOL, SINT"),
        ('Type="LREAL"/>', 'Type="ANY_THING"/>', "unknown generic type ANY_THING: expected ANY, "),
        ('"2.5"', '"fast"', "'fast' is not a LREAL: expected a number such as 1.5"),
        ('ArraySize="4"', 'ArraySize="four"', "array size 'four': expected a number or bounds such as 1..3"),
        ('ArraySize="4"', 'ArraySize="99999"', "array of 99999 elements: expected at most 65535"),
        ('ArraySize="4"', 'ArraySize="0"', "array bounds 0..-1"),
        ('"[1, 2, 3]"', '"[1, 2, 3, 4]"', "more than the 3 elements"),
        ('With Var="X"', 'With Var="Y"', "unknown input variable Y in WITH of REQ: expected X or DT"),
        ("<With Var", "<Wiht Var", "unknown element <Wiht> in <Event>: expected <With>"),
        (
            "<VarDeclaration Comment",
            "<Var Comment",
            "unknown element <Var> in <InputVars>: expected <VarDeclaration>",
        ),
        ('Algorithm="SCALE"', 'Algorithm="SCALES"', "unknown algorithm SCALES: expected SCALE"),
        ('Output="CNF"', 'Output="REQ"', "unknown event output REQ: expected CNF"),
        ('Destination="RUN"', 'Destination="RAN"', "transition from or to unknown state RAN: expected START or RUN"),
        ('<ECState Name="RUN"', '<ECState Name="START"', "state START is already declared in line 29"),
        ('Condition="1"', 'Condition=""', "<ECTransition> needs the attribute Condition"),
        (
            "<InternalVars>",
            "<InternalVars><FB Name='F' Type='E_SR'/>",
            "unknown block type E_SR: expected a file E_SR.fbt",
        ),
        (
            "</OutputVars>",
            "</OutputVars><Plugs><AdapterDeclaration Name='A' Type='T'/></Plugs>",
            "unknown adapter type T",
        ),
        (
            "</OutputVars>",
            "</OutputVars><InOutVars><VarDeclaration Name='V' Type='ANY'/></InOutVars>",
            "VAR_IN_OUT V is not supported here",
        ),
        ("<BasicFB>", "<Thing/><BasicFB>", "unknown element <Thing> in <FBType>: expected <InterfaceList>"),
        ("</ECC>", "<ECX/></ECC>", "unknown element <ECX> in <ECC>: expected <ECState>"),
    ],
)
def test_errors_name_file_and_line(write: Write, old: str, new: str, message: str) -> None:
    path = write("SCALE.fbt", BASIC, (old, new))
    with pytest.raises(FunctionBlockError, match=re.escape(message)) as caught:
        read_type(path)
    assert caught.value.file == str(path)
    if "already declared" not in message and "of CNF" not in message:
        assert caught.value.line == line_of(new, path)
    assert "\n" not in str(caught.value)


def test_other_languages_are_named(write: Write) -> None:
    path = write("SCALE.fbt", BASIC, ("<ST Text", '<Other Language="Java" Text'))
    with pytest.raises(
        FunctionBlockError, match="algorithm SCALE in Java is not supported: expected Structured Text"
    ):
        read_type(path)


def test_xml_that_is_not_well_formed(write: Write) -> None:
    path = write("SCALE.fbt", BASIC, ("<BasicFB>", "<BaiscFB>"))
    with pytest.raises(FunctionBlockError, match="not well-formed XML: Opening and ending tag mismatch") as caught:
        read_type(path)
    assert (caught.value.file, caught.value.line) == (str(path), line_of("</BasicFB>", path))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Y := X&#10;  * K[2];", "Y := X&#10;  * Z;", "algorithm SCALE, line 2, column 5: "),
        ("Y := X&#10;  * K[2];", "Y := := X;", "algorithm SCALE, line 1, column 6: "),
        ("REQ[X &gt; 0.0]", "REQ[Z]", "condition 'Z', column 1: "),
        ("REQ[X &gt; 0.0]", "REQ[X]", "condition 'X', column 1: "),
        ("Y := X&#10;  * K[2];", "X := Y;", "algorithm SCALE, line 1, column 1: "),
    ],
)
def test_errors_in_algorithms_and_conditions(write: Write, old: str, new: str, message: str) -> None:
    path = write("SCALE.fbt", BASIC, (old, new))
    with pytest.raises(FunctionBlockError, match=re.escape(message)) as caught:
        Resource(model.FBNetwork((model.Block("S", "SCALE"),)), Library([path.parent]))
    assert (caught.value.file, caught.value.line) == (str(path), line_of(new, path))


def test_lines_of_text_that_is_not_an_attribute_are_exact(write: Write) -> None:
    text = "<ST><![CDATA[\nY := X;\nY := Z;\n]]></ST>"
    path = write("SCALE.fbt", BASIC, ('<ST Text="Y := X&#10;  * K[2];"/>', text))
    with pytest.raises(FunctionBlockError) as caught:
        Resource(model.FBNetwork((model.Block("S", "SCALE"),)), Library([path.parent]))
    assert (caught.value.line, caught.value.column) == (line_of("Z;", path), 6)


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("1", ("", "")),
        ("REQ", ("REQ", "")),
        (" REQ [ X > 1 ] ", ("REQ", "X > 1")),
        ("REQ[A[1] > B[2]]", ("REQ", "A[1] > B[2]")),
        ("[X]", ("", "X")),
        ("X", ("", "X")),
        ("REQUEST", ("", "REQUEST")),
        ("REQ & (X = 1)", ("REQ", "(X = 1)")),
        ("REQ AND X", ("REQ", "X")),
        ("REQ[1]", ("REQ", "")),
    ],
)
def test_conditions(condition: str, expected: tuple[str, str]) -> None:
    assert split_condition(condition, ["REQ", "INIT"]) == expected


@given(st.data())
def test_any_change_of_a_file_gives_a_block_or_an_error(data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(BASIC)))
    end = data.draw(st.integers(start, min(start + 40, len(BASIC))))
    text = BASIC[:start] + data.draw(st.text(max_size=5)) + BASIC[end:]
    with contextlib.suppress(FunctionBlockError):
        block = type_from_xml(parse_xml(text.encode("utf-8", "surrogatepass"), "x.fbt"))
        assert isinstance(block, model.BasicFBType | model.SimpleFBType | model.ServiceInterfaceFBType)


def test_unreadable_files(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "missing.fbt"):
        with pytest.raises(FunctionBlockError, match="cannot be read"):
            read_type(path)


FEATURES = re.compile(
    "not supported|unknown generic type|unknown element|is not an? |out of the range|beyond the range"
)


def test_a_foreign_library_is_read_or_the_feature_named() -> None:
    folder = os.environ.get("IEC61499_LIBRARY")
    if not folder:
        pytest.skip("needs the environment variable IEC61499_LIBRARY: a folder of .fbt files, such as 4diac IDE's")
    files = [path for path in sorted(Path(folder).rglob("*")) if path.suffix in (".fbt", ".sub")]
    assert files
    unexplained = []
    read = 0
    for path in files:
        try:
            read_type(path)
            read += 1
        except FunctionBlockError as error:
            if not FEATURES.search(error.message):
                unexplained.append(str(error))
    assert unexplained == []
    assert read > 0


def test_methods_that_nothing_calls_are_passed_over(write: Write) -> None:
    method = '<Method Name="LEFT_OVER"><ST>nothing readable</ST></Method>'
    path = write("SCALE.fbt", BASIC, ("</BasicFB>", f"{method}</BasicFB>"))
    found = read_type(path)
    assert isinstance(found, model.BasicFBType)
    assert [algorithm.name for algorithm in found.algorithms] == ["SCALE"]
    path = write(
        "SCALE.fbt", BASIC, ("</BasicFB>", f"{method}</BasicFB>"), ('Text="Y := X', 'Text="Y := left_over (X)')
    )
    with pytest.raises(
        FunctionBlockError, match="method LEFT_OVER is not supported: expected algorithms that call none"
    ):
        read_type(path)


def test_one_literal_for_an_array_is_that_of_every_element(write: Write) -> None:
    found = read_type(write("SCALE.fbt", BASIC, ('InitialValue="[1, 2, 3]"', 'InitialValue="7"')))
    assert isinstance(found, model.BasicFBType)
    assert [model.initial_value(variable) for variable in found.internals] == [[7, 7, 7]]
