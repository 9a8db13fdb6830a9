"""The rules of `fb check`: each finds its case in a type that is otherwise right, and nothing in one that is."""

from __future__ import annotations

from pathlib import Path

import pytest

from iec61499.lint.check import check
from iec61499.lint.findings import RULES
from iec61499.lint.settings import Settings

TYPE = """<FBType Name="T"><InterfaceList>
<EventInputs><Event Name="REQ"><With Var="A"/><With Var="N"/></Event>EVENTS</EventInputs>
<EventOutputs><Event Name="CNF"><With Var="B"/></Event></EventOutputs>
<InputVars><VarDeclaration Name="A" Type="INT"/><VarDeclaration Name="N" Type="LREAL"/>INPUTS</InputVars>
<OutputVars><VarDeclaration Name="B" Type="DINT"/>OUTPUTS</OutputVars></InterfaceList>
<BasicFB><InternalVars><VarDeclaration Name="K" Type="INT"/>INTERNALS</InternalVars>
<ECC><ECState Name="START"/><ECState Name="DO"><ECAction Algorithm="WORK" Output="CNF"/></ECState>STATES
<ECTransition Source="START" Destination="DO" Condition="REQ"/>
<ECTransition Source="DO" Destination="START" Condition="1"/>TRANSITIONS</ECC>
<Algorithm Name="WORK"><ST><![CDATA[K := A;
IF N > 1.0 THEN
  B := K;
END_IF;
CODE]]></ST></Algorithm>ALGORITHMS</BasicFB></FBType>"""
PLACES = ("EVENTS", "INPUTS", "OUTPUTS", "INTERNALS", "STATES", "TRANSITIONS", "CODE", "ALGORITHMS")
CASES = {
    "unused-variable": {"INTERNALS": '<VarDeclaration Name="SPARE" Type="INT"/>'},
    "never-read": {"INTERNALS": '<VarDeclaration Name="W" Type="INT"/>', "CODE": "W := A;"},
    "never-written": {"INTERNALS": '<VarDeclaration Name="R" Type="INT"/>', "CODE": "B := R;"},
    "unused-input": {
        "EVENTS": '<Event Name="E"><With Var="C"/></Event>',
        "INPUTS": '<VarDeclaration Name="C" Type="INT"/>',
    },
    "not-sampled": {"INPUTS": '<VarDeclaration Name="C" Type="INT"/>', "CODE": "B := C;"},
    "not-published": {"OUTPUTS": '<VarDeclaration Name="O" Type="INT"/>', "CODE": "O := 1;"},
    "constant-without-value": {"CODE": "B := C;"},
    "unused-algorithm": {"ALGORITHMS": '<Algorithm Name="SPARE"><ST>K := 1;</ST></Algorithm>'},
    "reserved-name": {"INTERNALS": '<VarDeclaration Name="DWORD" Type="INT"/>'},
    "unreachable-state": {"STATES": '<ECState Name="ISLAND"/>'},
    "stuck-state": {
        "STATES": '<ECState Name="END"/>',
        "TRANSITIONS": '<ECTransition Source="START" Destination="END" Condition="[A = 3]"/>',
    },
    "transition-never-fires": {
        "TRANSITIONS": '<ECTransition Source="START" Destination="START" Condition="REQ[A = 3]"/>'
    },
    "condition-is-constant": {
        "TRANSITIONS": '<ECTransition Source="START" Destination="START" Condition="[FALSE]"/>'
    },
    "endless-chart": {
        "STATES": '<ECState Name="X"/>',
        "TRANSITIONS": '<ECTransition Source="START" Destination="X" Condition="[A = 3]"/>'
        '<ECTransition Source="X" Destination="X" Condition="1"/>',
    },
    "ignored-event": {"EVENTS": '<Event Name="E"/>'},
    "duplicate-case-label": {"CODE": "CASE A OF 1..3: K := 1; 2: K := 2; END_CASE;"},
    "unreachable-code": {"CODE": "RETURN; K := 1;"},
    "no-effect": {"CODE": "K := K;"},
    "narrow-arithmetic": {"CODE": "B := A * K;"},
    "real-equality": {"CODE": "IF N = N THEN K := 1; END_IF;"},
}
NETWORK = """<FBType Name="T"><InterfaceList><EventInputs><Event Name="GO"/></EventInputs></InterfaceList><FBNetwork>
<FB Name="ONE" Type="STEP"/><FB Name="TWO" Type="STEP"/>
<EventConnections>CONNECTIONS</EventConnections></FBNetwork></FBType>"""
STEP = """<FBType Name="STEP"><InterfaceList><EventInputs><Event Name="REQ"/></EventInputs>
<EventOutputs><Event Name="CNF"/></EventOutputs></InterfaceList><BasicFB><ECC>
<ECState Name="START"/><ECState Name="DO"><ECAction Output="CNF"/></ECState>
<ECTransition Source="START" Destination="DO" Condition="REQ"/>
<ECTransition Source="DO" Destination="START" Condition="1"/></ECC></BasicFB></FBType>"""


def found_in(folder: Path, text: str, settings: Settings | None = None) -> dict[str, int]:
    """Rules and lines of what is found in a type."""
    file = folder / "T.fbt"
    file.write_text(text)
    return {finding.rule: finding.line for finding in check([file], folder, "embedded", settings or Settings())}


def type_with(parts: dict[str, str]) -> str:
    text = TYPE
    for place in PLACES:
        text = text.replace(place, parts.get(place, ""))
    return text


def test_nothing_is_found_in_what_is_right(tmp_path: Path) -> None:
    assert found_in(tmp_path, type_with({})) == {}


@pytest.mark.parametrize("rule", CASES)
def test_each_rule_finds_its_case(tmp_path: Path, rule: str) -> None:
    text = type_with(CASES[rule])
    if rule == "constant-without-value":
        constant = '<InternalConstVars><VarDeclaration Name="C" Type="INT"/></InternalConstVars><ECC>'
        text = text.replace("<ECC>", constant, 1)
    assert rule in found_in(tmp_path, text)


def test_each_case_is_found_where_it_is(tmp_path: Path) -> None:
    assert found_in(tmp_path, type_with(CASES["duplicate-case-label"])) == {"duplicate-case-label": 14}
    assert found_in(tmp_path, type_with(CASES["unreachable-code"])) == {"unreachable-code": 14}


def test_events_of_networks(tmp_path: Path) -> None:
    (tmp_path / "STEP.fbt").write_text(STEP)
    line = '<Connection Source="{}" Destination="{}"/>'
    once = line.format("GO", "ONE.REQ")
    assert found_in(tmp_path, NETWORK.replace("CONNECTIONS", once)) == {"never-triggered": 2}
    through = once + line.format("ONE.CNF", "TWO.REQ")
    assert found_in(tmp_path, NETWORK.replace("CONNECTIONS", through)) == {}
    back = through + line.format("TWO.CNF", "ONE.REQ")
    assert found_in(tmp_path, NETWORK.replace("CONNECTIONS", back)) == {"event-loop": 3}


def test_what_the_standard_and_adapters_bring_is_no_finding(tmp_path: Path) -> None:
    adapter = """<AdapterType Name="AX"><InterfaceList>
<EventInputs><Event Name="ASK"/><Event Name="MORE"/></EventInputs>
<EventOutputs><Event Name="SAY"/><Event Name="TOO"/></EventOutputs></InterfaceList></AdapterType>"""
    (tmp_path / "AX.adp").write_text(adapter)
    text = type_with({}).replace('Name="N"', 'Name="DT"').replace('Var="N"', 'Var="DT"').replace("IF N >", "IF DT >")
    plug = '<Plugs><AdapterDeclaration Name="P" Type="AX"/></Plugs>'
    assert found_in(tmp_path, text.replace("</InterfaceList>", f"{plug}</InterfaceList>")) == {}


def test_true_alone_is_another_way_to_write_1(tmp_path: Path) -> None:
    text = type_with({})
    assert found_in(tmp_path, text.replace('Condition="1"', 'Condition="[TRUE]"')) == {}
    assert "condition-is-constant" in found_in(tmp_path, text.replace('Condition="REQ"', 'Condition="REQ[TRUE]"'))


def test_a_type_of_hardware_is_right_and_does_not_run(tmp_path: Path) -> None:
    text = '<FBType Name="T"><InterfaceList><EventInputs><Event Name="REQ"/></EventInputs></InterfaceList></FBType>'
    assert found_in(tmp_path, text) == {"no-such-service": 1}


def test_what_a_block_inside_lacks_is_told_once(tmp_path: Path) -> None:
    empty = "<InterfaceList><EventInputs><Event Name='GO'/></EventInputs></InterfaceList>"
    (tmp_path / "HARD.fbt").write_text(f'<FBType Name="HARD">{empty}</FBType>')
    files = []
    for name, inner in (("LOW", "HARD"), ("MIDDLE", "LOW"), ("HIGH", "MIDDLE")):
        files.append(tmp_path / f"{name}.fbt")
        wire = '<EventConnections><Connection Source="GO" Destination="B.GO"/></EventConnections>'
        network = f'<FBNetwork><FB Name="B" Type="{inner}"/>{wire}</FBNetwork>'
        files[-1].write_text(f'<FBType Name="{name}">{empty}{network}</FBType>')
    found = check(files, tmp_path, "embedded", Settings())
    assert [(Path(f.file).name, f.rule, f.message.partition(" ")[0]) for f in found] == [
        ("LOW.fbt", "no-such-service", "LOW.B")
    ]


def test_what_is_right_elsewhere_is_told_as_not_supported(tmp_path: Path) -> None:
    (tmp_path / "HALF.fct").write_text(
        '<Function Name="HALF"><InterfaceList><EventInputs><Event Name="REQ"><With Var="X"/></Event></EventInputs>'
        '<EventOutputs><Event Name="CNF"><With Var=""/></Event></EventOutputs>'
        '<InputVars><VarDeclaration Name="X" Type="DINT"/></InputVars>'
        '<OutputVars><VarDeclaration Name="" Type="DINT"/></OutputVars></InterfaceList><FunctionBody>'
        "<ST>FUNCTION HALF : DINT\nVAR_INPUT\nX : DINT;\nEND_VAR\nHALF := X / 2;\nEND_FUNCTION</ST>"
        "</FunctionBody></Function>"
    )
    for code in ("B := HALF(B);", "WORK();", "THIS.WORK();"):
        text = type_with({"CODE": code})
        assert found_in(tmp_path, text) == {"not-supported": 14}, code
    assert found_in(tmp_path, type_with({"CODE": "B := WHOLE(B);"})) == {"invalid": 14}


def test_a_connection_that_is_drawn_twice_is_told_and_runs_once(tmp_path: Path) -> None:
    data = '<Connection Source="M.OUT" Destination="N.IN"/>\n' * 2
    text = f"""<FBType Name="T"><InterfaceList><EventInputs><Event Name="GO"/></EventInputs></InterfaceList>
<FBNetwork><FB Name="M" Type="INT2INT"/><FB Name="N" Type="INT2INT"/><EventConnections>
<Connection Source="GO" Destination="M.REQ"/><Connection Source="M.CNF" Destination="N.REQ"/></EventConnections>
<DataConnections>{data}</DataConnections></FBNetwork></FBType>"""
    assert found_in(tmp_path, text) == {"duplicate-connection": 5}


def test_mistakes_are_told_beside_what_the_rules_find(tmp_path: Path) -> None:
    parts = {"CODE": "UNKNOWN := 1;", "STATES": '<ECState Name="ISLAND"/>'}
    assert {"invalid", "unreachable-state"} <= {*found_in(tmp_path, type_with(parts))}


def test_every_rule_has_a_sentence() -> None:
    assert all(rule.text.endswith(".") and rule.name == name for name, rule in RULES.items())


SENDER = """<FBType Name="T"><InterfaceList/><FBNetwork><FB Name="P" Type="PUBLISH_0">
<Parameter Name="ID" Value="&quot;{}&quot;"/></FB></FBNetwork></FBType>"""


@pytest.mark.parametrize(
    ("identifier", "package", "extra"),
    [
        ("opc_ua[CREATE_OBJECT;,0:i=58;/Objects/1:Press]", "asyncua", "opcua"),
        ("fbdk[].mqtt[tcp://127.0.0.1:1883, press, plant]", "paho", "mqtt"),
    ],
)
def test_a_protocol_can_run_when_its_library_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, identifier: str, package: str, extra: str
) -> None:
    pytest.importorskip(package, reason=f"the extra {extra} is not installed")
    text = SENDER.format(identifier)
    assert "no-such-protocol" not in found_in(tmp_path, text)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    file = tmp_path / "T.fbt"
    (told,) = [each for each in check([file], tmp_path, "embedded", Settings()) if each.rule == "no-such-protocol"]
    assert f"needs the package {package}: pip install 'iec61499[{extra}]'" in told.message


def test_an_identifier_of_another_form_cannot_run(tmp_path: Path) -> None:
    for identifier in ("opc_ua[/Objects/1:Press]", "fbdk[].http[x]", "press:61500", "fbdk[].ip[1:"):
        assert "no-such-protocol" in found_in(tmp_path, SENDER.format(identifier))
    assert "no-such-protocol" not in found_in(tmp_path, SENDER.format("raw[].ip[127.0.0.1:1]"))
