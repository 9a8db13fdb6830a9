"""What a new user of the block commands does wrong: each is one line that names the place and what was expected."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.cli import main

SYSTEM = """<System Name="S">
<Device Name="D" Type="FORTE_PC"><Resource Name="R" Type="EMB_RES"><FBNetwork>
<FB Name="C" Type="E_CTU"/>
<FB Name="W" Type="E_DELAY"/>
<EventConnections><Connection Source="START.COLD" Destination="C.CU"/></EventConnections>
<DataConnections><Connection Source="C.CV" Destination="W.DT"/></DataConnections>
</FBNetwork></Resource></Device></System>
"""
FITTING = SYSTEM.replace('<Connection Source="C.CV" Destination="W.DT"/>', "")
CREATE = ';<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>\n'


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        (SYSTEM, 6, "C.CV"),
        (FITTING.replace("E_DELAY", "E_DELAYED"), 4, "unknown block type E_DELAYED: expected E_DELAY"),
        (FITTING.replace('Name="W"', 'Name="C"'), 4, "C is already declared in line 3"),
        (FITTING.replace('"C.CU"', '"C.CO"'), 5, "C.CO"),
        (FITTING.replace('"C.CU"', '"X.CU"'), 5, "X"),
    ],
)
def test_a_mistake_in_a_system_is_told_with_its_line(
    text: str, line: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "s.sys"
    file.write_text(text)
    assert main(["fb", "check", str(file)]) == 1
    told, summary = capsys.readouterr().out.splitlines()
    assert told.startswith(f"{file}:{line}")
    assert said in told
    assert summary == "files: 1, problems: 1"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (CREATE + 'R;<Request ID="2" Action="CREATE"><FB Name="C" Ty', "s.fboot:2"),
        (CREATE + 'Q;<Request ID="2" Action="START"/>\n', "s.fboot:2: START refused"),
        (CREATE + CREATE, "s.fboot:2: CREATE block R of type EMB_RES refused: INVALID_STATE"),
        (CREATE.replace("EMB_RES", "EMB_REZ"), "resource type 'EMB_REZ': expected EMB_RES"),
        (SYSTEM, "s.fboot:1: expected RESOURCE;<Request ...>"),
    ],
)
def test_a_mistake_in_a_boot_file_is_told_with_its_line(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "s.fboot"
    file.write_text(text)
    assert main(["fb", "run", str(file), "--listen", "127.0.0.1:0"]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


BLOCK = """<FBType Name="MINE"><InterfaceList>
<EventInputs><Event Name="REQ"><With Var="A"/><With Var="N"/></Event><Event Name="HALT"/></EventInputs>
<EventOutputs><Event Name="CNF"><With Var="OUT"/><With Var="TEXT"/><With Var="LIST"/></Event></EventOutputs>
<InputVars><VarDeclaration Name="A" Type="LREAL"/><VarDeclaration Name="N" Type="INT"/></InputVars>
<OutputVars><VarDeclaration Name="OUT" Type="LREAL"/><VarDeclaration Name="TEXT" Type="STRING"/>
<VarDeclaration Name="LIST" Type="INT" ArraySize="4"/></OutputVars>
</InterfaceList><BasicFB>
<ECC><ECState Name="START"/><ECState Name="DO"><ECAction Algorithm="DO" Output="CNF"/></ECState>
<ECTransition Source="START" Destination="DO" Condition="REQ"/>
<ECTransition Source="DO" Destination="START" Condition="1"/></ECC>
<Algorithm Name="DO"><ST><![CDATA[
TEXT := ''; OUT := A;]]></ST></Algorithm>
</BasicFB></FBType>
"""
BLANK = "OUT := A;"


@pytest.mark.parametrize(
    ("right", "wrong", "place", "said"),
    [
        (BLANK, "OUT := A ^ 2;", "12:22", "unexpected '^': expected ** or EXPT"),
        (BLANK, "OUT := A\u00b2;", "12:21", "expected ** 2"),
        (BLANK, "OUT := SIN(90\u00b0);", "12:26", "expected an angle in radians"),
        (BLANK, "OUT := N % 2;", "12:22", "unexpected '%': expected MOD"),
        (BLANK, "OUT := A > 1.0 ? 1.0 : 2.0;", "12:28", "unexpected '?': expected SEL(B, X, Y) or IF"),
        (BLANK, "OUT := SQR(A);", "12:20", "unknown function SQR: expected SQRT"),
        (BLANK, "TEXT := 'a' + 'b';", "12:21", "+ expects ANY_NUM, got STRING; texts are joined by CONCAT"),
        (BLANK, "IF 0 < N < 5 THEN OUT := A; END_IF;", "12:22", "two comparisons are joined by AND"),
        (BLANK, "OUT := 1,5;", "12:21", "unexpected ','"),
        (BLANK, "LIST[4] := 1;", "12:18", "index 4 of LIST: expected 0 to 3"),
        (BLANK, "OUT := A; (* not done", "12:23", "comment is not closed: expected *)"),
        (
            '"REQ"/>\n',
            '"REQ OR HALT"/>\n',
            "9",
            "expected one event and a guard, as in REQ[X > 0]; another event has",
        ),
        ('"REQ"/>\n', '"REG"/>\n', "9", "condition 'REG', column 1: unknown variable REG"),
        ('"REQ"/>\n', '"REQ[N := 1]"/>\n', "9", "unexpected ':='"),
        ('<With Var="N"/>', '<With Var="M"/>', "2", "unknown input variable M in WITH of REQ: expected A or N"),
        ('ECAction Algorithm="DO"', 'ECAction Algorithm="DOO"', "8", "unknown algorithm DOO: expected DO"),
        ('Type="INT"/></Input', 'Type="INT" InitialValue="1.5"/></Input', "4", "'1.5' is not a INT"),
        ('Name="A" Type="LREAL"', 'Name="A" Type="FLOAT"', "4", "unknown type 'FLOAT': expected BOOL"),
    ],
)
def test_a_mistake_in_a_block_is_told_with_its_place(
    right: str, wrong: str, place: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "MINE.fbt"
    file.write_text(BLOCK)
    assert main(["fb", "check", str(file)]) == 0, capsys.readouterr().out
    assert right in BLOCK
    file.write_text(BLOCK.replace(right, wrong, 1), encoding="utf-8")
    capsys.readouterr()
    assert main(["fb", "check", str(file)]) == 1
    told = capsys.readouterr().out.splitlines()[0]
    assert told.startswith(f"{file}:{place}: ")
    assert said in told


MAPPED = """<System Name="S">
<Application Name="APP"><SubAppNetwork><FB Name="C" Type="E_CTU"/></SubAppNetwork></Application>
<Device Name="D" Type="FORTE_PC"><Resource Name="R" Type="EMB_RES"><FBNetwork/></Resource>
<Resource Name="Q" Type="EMB_RES"><FBNetwork/></Resource></Device>
<Mapping From="{}" To="{}"/>{}
</System>
"""


@pytest.mark.parametrize(
    ("source", "destination", "more", "said"),
    [
        ("APP.C", "D.P.C", "", "5: mapping to unknown resource 'D.P.C': expected D.R or D.Q"),
        ("APP.C", "X.R.C", "", "5: mapping to unknown resource 'X.R.C': expected D.R or D.Q"),
        ("APP.B", "D.R.B", "", "5: mapping of unknown block 'APP.B': expected APP.C"),
        ("C", "D.R.C", "", "5: mapping of unknown block 'C': expected APP.C"),
        ("APP.C", "D.R.C", '\n<Mapping From="APP.C" To="D.Q.C"/>', "6: APP.C is mapped to D.R already, in line 5"),
    ],
)
def test_a_mistake_in_a_mapping_is_told_with_its_line(
    source: str, destination: str, more: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "s.sys"
    file.write_text(MAPPED.format(source, destination, more))
    assert main(["fb", "check", str(file)]) == 1
    assert capsys.readouterr().out.startswith(f"{file}:{said}")


COUNTER = CREATE + 'R;<Request ID="2" Action="CREATE"><FB Name="C" Type="E_CTU" /></Request>\n'
WRITE = 'R;<Request ID="3" Action="{}"><Connection Source="{}" Destination="C.PV" /></Request>\n'


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (COUNTER + WRITE.format("WRITE", "abc"), "3: WRITE abc to C.PV refused: BAD_PARAMS, 'abc' is not a UINT"),
        (COUNTER + WRITE.format("CREATE", "START.COLD"), "3: CREATE START.COLD -> C.PV refused: NO_SUCH_OBJECT, no"),
        (COUNTER.replace('"2" Action="CREATE"', '"2" Action="MAKE"'), "2: expected <Request> with the Action CREATE"),
        (CREATE + '<Request ID="2" Action="START"/>\n', "2: expected RESOURCE;<Request ...>, with nothing before ;"),
        (CREATE.encode("utf-16"), "is not UTF-8 at byte 0"),
    ],
)
def test_a_mistake_in_what_a_device_is_told_has_its_line(
    content: str | bytes, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "s.fboot"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert main(["fb", "run", str(file), "--listen", "127.0.0.1:0"]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("fb check nowhere", "nowhere: there is no such file or folder"),
        ("fb check empty", "empty: expected a folder with files that end in .fboot, .fbt"),
        ("fb run empty", "empty: expected a system (.sys) or a boot file (.fboot)"),
        ("fb run --listen 127.0.0.1", "expected HOST:PORT with a port from 0 to 65535"),
        ("fb deploy localhost:http", "expected HOST:PORT with a port from 0 to 65535"),
        ("fb export --format cpp out", "--format: expected c, fboot, forte or lua, got 'cpp'"),
        ("fb force 127.0.0.1:1", "expected NAME=VALUE, e.g. CELL.PUMP.SPEED=2.5"),
    ],
)
def test_a_mistake_in_a_command_of_blocks_is_one_line(
    words: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    assert main(words.split()) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1
