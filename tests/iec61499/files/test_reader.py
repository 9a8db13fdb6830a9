"""Reading .fbt, .sub and .sys files: what 4diac IDE writes, errors with their line, and hostile XML."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.files.block_types import read_type, split_condition, type_from_xml
from dtwin.iec61499.files.xml import MAXIMUM_DEPTH, MAXIMUM_SIZE, parse_xml
from dtwin.iec61499.library import Library
from dtwin.iec61499.mapping import resource_network
from dtwin.iec61499.runtime.resource import Resource
from dtwin.iec61499.types import INT, LREAL, TIME, ArrayType

BASIC = """<?xml version="1.0" encoding="UTF-8" standalone="no"?>
<!DOCTYPE FBType SYSTEM "http://www.holobloc.com/xml/LibraryElement.dtd">
<FBType Comment="Scales" Name="SCALE">
  <Identification Description="one&#10;two" Standard="61499-2"/>
  <VersionInfo Author="A" Date="2024-01-02" Organization="O" Remarks="first" Version="1.0"/>
  <CompilerInfo packageName="my::package"><Import declaration="other::TYPE"/></CompilerInfo>
  <InterfaceList>
    <EventInputs>
      <Event Comment="go" Name="REQ" Type="Event">
        <With Var="X"/>
      </Event>
    </EventInputs>
    <EventOutputs>
      <Event Name="CNF" Type="Event"><With Var="Y"/><Attribute Name="Z" Value="1"/></Event>
    </EventOutputs>
    <InputVars>
      <VarDeclaration Comment="m" InitialValue="2.5" Name="X" Type="LREAL"/>
      <VarDeclaration ArraySize="4" Name="DT" Type="TIME"/>
    </InputVars>
    <OutputVars>
      <VarDeclaration Name="Y" Type="LREAL"><Attribute Name="Visible" Value="false"/></VarDeclaration>
    </OutputVars>
  </InterfaceList>
  <BasicFB>
    <InternalVars>
      <VarDeclaration ArraySize="1..3" InitialValue="[1, 2, 3]" Name="K" Type="INT"/>
    </InternalVars>
    <ECC>
      <ECState Comment="Initial" Name="START" x="475.0" y="1125.5"/>
      <ECState Name="RUN" x="1" y="2"><ECAction Algorithm="SCALE" Output="CNF"/></ECState>
      <ECTransition Condition="REQ[X &gt; 0.0]" Destination="RUN" Source="START" x="840.0" y="920.0"/>
      <ECTransition Condition="1" Destination="START" Source="RUN"/>
    </ECC>
    <Algorithm Comment="c" Name="SCALE">
      <ST Text="Y := X&#10;  * K[2];"/>
    </Algorithm>
  </BasicFB>
  <Attribute Name="eclipse4diac::core::TypeHash" Value="''"/>
</FBType>
"""
Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_file(name: str, text: str, *changes: tuple[str, str]) -> Path:
        for old, new in changes:
            assert text.count(old) >= 1, old
            text = text.replace(old, new, 1)
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write_file


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
        ('Type="LREAL"/>', 'Type="COLOUR"/>', "variable X: type 'COLOUR' is not supported: expected BOOL, SINT"),
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
            "block F inside a basic block is not supported",
        ),
        ("</OutputVars>", "</OutputVars><Plugs><AdapterDeclaration Name='A'/></Plugs>", "adapter A is not supported"),
        (
            "</OutputVars>",
            "</OutputVars><InOutVars><VarDeclaration Name='V'/></InOutVars>",
            "VAR_IN_OUT variable V is",
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


def line_of(text: str, path: Path) -> int:
    content = path.read_text(encoding="utf-8")
    return content[: content.index(text)].count("\n") + 1


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


REFUSED = re.compile("entit|not well-formed|deeper than 64")
BOMB = '<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]><FBType Name="&b;"/>'
EXTERNAL = '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/hostname">]><FBType Name="A"><X>&a;</X></FBType>'
PARAMETER = '<!DOCTYPE x [<!ENTITY % p SYSTEM "file:///etc/hostname"> %p;]><FBType Name="A"/>'
LAUGHS = (
    "<!DOCTYPE l ["
    + "".join(f'<!ENTITY l{i + 1} "{f"&l{i};" * 10}">' for i in range(9))
    + '<!ENTITY l0 "lol">]><FBType Name="A">&l9;</FBType>'
)


@pytest.mark.parametrize("text", [BOMB, EXTERNAL, PARAMETER, LAUGHS])
def test_entities_are_refused(text: str) -> None:
    with pytest.raises(FunctionBlockError, match=REFUSED):
        parse_xml(text.encode(), "x.fbt")


def test_a_missing_or_remote_dtd_is_not_loaded(tmp_path: Path) -> None:
    text = f'<!DOCTYPE FBType SYSTEM "file://{tmp_path}/missing.dtd"><FBType Name="A"/>'
    assert parse_xml(text.encode(), "x.fbt").get("Name") == "A"
    with pytest.raises(FunctionBlockError, match=REFUSED):
        parse_xml(f'<!DOCTYPE A SYSTEM "file://{tmp_path}/x.dtd"><A>&e;</A>'.encode(), "x.fbt")


def test_size_and_depth_are_limited(tmp_path: Path) -> None:
    path = tmp_path / "BIG.fbt"
    path.write_bytes(b"<FBType>" + b" " * MAXIMUM_SIZE + b"</FBType>")
    with pytest.raises(FunctionBlockError, match=f"larger than {MAXIMUM_SIZE} bytes"):
        read_type(path)
    deepest = "<a>" * MAXIMUM_DEPTH + "</a>" * MAXIMUM_DEPTH
    assert parse_xml(deepest.encode(), "x").tag == "a"
    for depth in (MAXIMUM_DEPTH + 1, 100_000):
        with pytest.raises(FunctionBlockError, match=REFUSED):
            parse_xml(("<a>" * depth + "</a>" * depth).encode(), "x")


@given(st.binary(max_size=200))
def test_any_bytes_give_an_element_or_an_error(data: bytes) -> None:
    with pytest.raises(FunctionBlockError):
        type_from_xml(parse_xml(data, "x.fbt"))


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


def test_library_finds_types_in_subfolders(write: Write, tmp_path: Path) -> None:
    (tmp_path / "deep" / "er").mkdir(parents=True)
    write("deep/er/SCALE.fbt", BASIC)
    library = Library([tmp_path])
    assert library.names() == ("SCALE",)
    assert library.find("my::package::SCALE") is library.find("SCALE")
    with pytest.raises(FunctionBlockError, match=r"a\.sys:7: unknown block type SCALA: expected SCALE; searched"):
        library.find("SCALA", "a.sys", 7)
    write("SCALE.sub", BASIC)
    with pytest.raises(FunctionBlockError, match=r"SCALE.*type SCALE is also in .*: expected one file"):
        Library([tmp_path])
    with pytest.raises(FunctionBlockError, match="is not a folder of block types"):
        Library([tmp_path / "SCALE.sub"])


def test_a_file_is_named_after_its_type(write: Write, tmp_path: Path) -> None:
    write("OTHER.fbt", BASIC)
    with pytest.raises(FunctionBlockError, match="holds the type SCALE: expected OTHER, as the file's name says"):
        Library([tmp_path]).find("OTHER")


def test_types_of_a_folder_hide_standard_blocks_if_they_do_something(write: Write, tmp_path: Path) -> None:
    write("E_SWITCH.fbt", BASIC, ('Name="SCALE"', 'Name="E_SWITCH"'))
    basic = BASIC[BASIC.index("  <BasicFB>") : BASIC.index("</BasicFB>") + 10]
    write("E_DELAY.fbt", BASIC, ('Name="SCALE"', 'Name="E_DELAY"'), (basic, ""))
    library = Library([tmp_path])
    assert library.find("E_SWITCH").interface.event_inputs[0].name == "REQ"
    assert library.find("E_DELAY").interface.event_inputs[0].name == "START"


SYSTEM = """<?xml version="1.0" encoding="UTF-8"?>
<System Name="TEST">
  <VersionInfo Version="1.0" Author="A"/>
  <Application Name="APP">
    <SubAppNetwork>
      <FB Name="COUNT" Type="E_CTU" x="100.0" y="200.0"><Parameter Name="PV" Value="UINT#2"/></FB>
      <FB Name="LATCH" Type="iec61499::events::E_D_FF"/>
      <FB Name="ELSEWHERE" Type="E_SR"/>
      <SubApp Name="INNER">
        <SubAppInterfaceList>
          <SubAppEventInputs><SubAppEvent Name="GO" Type="Event"/></SubAppEventInputs>
        </SubAppInterfaceList>
        <SubAppNetwork>
          <FB Name="N" Type="E_CTU"/>
          <EventConnections><Connection Source="GO" Destination="N.CU"/></EventConnections>
        </SubAppNetwork>
      </SubApp>
      <Group Name="G"/>
      <EventConnections>
        <Connection Source="COUNT.CUO" Destination="LATCH.CLK"/>
        <Connection Source="COUNT.CUO" Destination="INNER.GO"/>
      </EventConnections>
      <DataConnections><Connection Source="COUNT.Q" Destination="LATCH.D"/></DataConnections>
    </SubAppNetwork>
  </Application>
  <Device Name="FORTE_PC" Type="FORTE_PC">
    <Parameter Name="MGR_ID" Value="&quot;localhost:61499&quot;"/>
    <Resource Name="RES" Type="EMB_RES">
      <FBNetwork>
        <FB Name="CYCLE" Type="E_CYCLE"><Parameter Name="DT" Value="T#10ms"/></FB>
        <EventConnections>
          <Connection Source="START.COLD" Destination="CYCLE.START"/>
          <Connection Source="CYCLE.EO" Destination="APP.COUNT.CU"/>
        </EventConnections>
      </FBNetwork>
    </Resource>
    <Resource Name="OTHER" Type="EMB_RES"/>
  </Device>
  <Mapping From="APP.COUNT" To="FORTE_PC.RES"/>
  <Mapping From="APP.LATCH" To="FORTE_PC.RES.LATCH"/>
  <Mapping From="APP.INNER" To="FORTE_PC.RES"/>
  <Segment Name="ETH" Type="Ethernet"/>
</System>
"""


@pytest.mark.parametrize("name", ["FORTE_PC.RES", "RES"])
def test_a_system_runs(write: Write, name: str) -> None:
    library = Library()
    system = library.load_system(write("test.sys", SYSTEM))
    assert system.devices[0].parameters[0].value == '"localhost:61499"'
    resource = Resource(resource_network(system, name), library)
    assert set(resource.names()) == {"START", "CYCLE", "COUNT", "LATCH", "INNER.N"}
    resource.start()
    resource.advance(25_000_000)
    assert [resource.read(n) for n in ("COUNT.CV", "LATCH.Q", "INNER.N.CV")] == [2, True, 2]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'To="FORTE_PC.RES"',
            'To="FORTE_PC.REST"',
            "mapping to unknown resource 'FORTE_PC.REST': expected FORTE_PC.RES",
        ),
        ('From="APP.COUNT"', 'From="APP.CUONT"', "mapping of unknown block 'APP.CUONT': expected APP.COUNT"),
        ('"COUNT.Q"', '"COUNT.QQ"', "connection COUNT.QQ -> LATCH.D: COUNT has no data output QQ: expected Q or CV"),
        ('Type="E_CTU" x', 'Type="E_CTV" x', "unknown block type E_CTV: expected E_CT"),
        ('"UINT#2"', '"UINT#-2"', "is out of the range of UINT"),
        ('Name="PV"', 'Name="PW"', "COUNT has no data input PW: expected PV"),
        ("APP.COUNT.CU", "APP.COUNT.CD", "COUNT has no event input CD: expected CU or R"),
        ('<FB Name="ELSEWHERE"', '<FB Name="LATCH"', "block LATCH is already declared in line 7"),
        ("<Segment", "<Sigment", "unknown element <Sigment> in <System>: expected <Application>, <Device>"),
    ],
)
def test_systems_that_are_wrong(write: Write, old: str, new: str, message: str) -> None:
    path = write("test.sys", SYSTEM, (old, new))
    library = Library()
    with pytest.raises(FunctionBlockError, match=re.escape(message)) as caught:
        Resource(resource_network(library.load_system(path), "RES"), library)
    assert caught.value.file == str(path)
    if "already declared" not in message:
        assert caught.value.line == line_of(new, path)


def test_connections_stay_on_a_resource(write: Write) -> None:
    path = write("test.sys", SYSTEM, ('To="FORTE_PC.RES"', 'To="FORTE_PC.OTHER"'))
    system = Library().load_system(path)
    with pytest.raises(FunctionBlockError, match=r"of application APP leaves resource FORTE_PC\.RES") as caught:
        resource_network(system, "RES")
    assert caught.value.line == line_of('"COUNT.CUO"', path)


def test_resources_are_named(write: Write) -> None:
    system = Library().load_system(write("test.sys", SYSTEM))
    with pytest.raises(FunctionBlockError, match=r"unknown resource 'X': expected FORTE_PC\.RES or FORTE_PC\.OTHER"):
        resource_network(system, "X")
    with pytest.raises(FunctionBlockError, match="more than one resource fits: expected"):
        resource_network(system)


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
