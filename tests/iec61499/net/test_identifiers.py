"""IDs of communication blocks with layers, OPC UA and MQTT, as 4diac FORTE reads them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dtwin.parameters import ROOT
from iec61499.errors import CommunicationError
from iec61499.net.layers import parse_layers
from iec61499.net.opcua.identifiers import Action, NodeName, Place, parse_action
from iec61499.net.settings import Peer, read_connections

PAGE = (ROOT / "docs" / "connections.md").read_text()
SERVER = "opc.tcp://localhost:4840"


def objects(*names: tuple[int, str]) -> tuple[tuple[int, str], ...]:
    return ((0, "Objects"), *names)


@pytest.mark.parametrize(
    ("text", "layers"),
    [
        ("fbdk[].ip[localhost:61500]", [("fbdk", ""), ("ip", "localhost:61500")]),
        ("raw[].mqtt[tcp://h:1, c, t/#]", [("raw", ""), ("mqtt", "tcp://h:1, c, t/#")]),
        ("opc_ua[READ;/Objects/1:a[0]]", [("opc_ua", "READ;/Objects/1:a[0]")]),
    ],
)
def test_layers_come_from_the_top(text: str, layers: list[tuple[str, str]]) -> None:
    assert parse_layers(text) == tuple(layers)


@pytest.mark.parametrize("text", ["fbdk[", "opc_ua[READ", "[]", "fbdk[].ip", "x]"])
def test_a_bracket_that_is_missing_is_told(text: str) -> None:
    with pytest.raises(CommunicationError, match=r"ID .*: expected HOST:PORT, fbdk\[\]\.ip"):
        parse_layers(text)


@pytest.mark.parametrize(
    ("text", "kind", "sends", "receives", "action"),
    [
        (
            "READ;/Objects/1:In/2:X",
            *("SUBSCRIBE", 0, 1),
            Action("READ", "", (Place(objects((1, "In"), (2, "X")), None),)),
        ),
        (
            f"WRITE;{SERVER}#;,1:s=a,b;/1:c/,i=7".replace("a,b", "ab"),
            *("CLIENT", 2, 0),
            Action("WRITE", SERVER, (Place((), NodeName(1, "s", "ab")), Place(((1, "c"),), NodeName(0, "i", 7)))),
        ),
        (
            f"SUBSCRIBE; {SERVER}#; ,0:i=2261",
            *("SUBSCRIBE", 0, 1),
            Action("SUBSCRIBE", SERVER, (Place((), NodeName(0, "i", 2261)),)),
        ),
        (
            "CREATE_METHOD;/Objects/serviceTest/start2",
            *("SERVER", 1, 2),
            Action("CREATE_METHOD", "", (Place(objects((1, "serviceTest"), (1, "start2")), None),)),
        ),
        (
            "CREATE_OBJECT;,2:i=15001;/Objects/testObject1",
            *("PUBLISH", 0, 0),
            Action(
                "CREATE_OBJECT",
                "",
                (Place((), NodeName(2, "i", 15001)), Place(objects((1, "testObject1")), None)),
            ),
        ),
        (
            "READ;/Objects/1:In,1:b=bytes",
            *("SUBSCRIBE", 0, 1),
            Action("READ", "", (Place(objects((1, "In")), NodeName(1, "b", "bytes")),)),
        ),
    ],
)
def test_actions_are_read_as_forte_reads_them(
    text: str, kind: str, sends: int, receives: int, action: Action
) -> None:
    assert parse_action(text, kind, sends, receives) == action


@pytest.mark.parametrize(
    ("text", "kind", "sends", "receives", "complaint"),
    [
        ("/Objects/1:CRANE1", "PUBLISH", 1, 0, "as of 4diac 1.11; this is the form before it"),
        ("opc.tcp://h:4840#/Objects/1:X", "CLIENT", 0, 1, "as of 4diac 1.11; this is the form before it"),
        ("CREATE_VARIBLE;/Objects/V", "PUBLISH", 0, 0, "expected READ, WRITE, CREATE_METHOD"),
        ("READ;/Objects/a", "PUBLISH", 1, 0, "expected a SUBSCRIBE with as many nodes as it has RD"),
        ("READ;/Objects/a;/Objects/b", "SUBSCRIBE", 0, 1, "2 nodes, 0 SD and 1 RD"),
        (f"READ;{SERVER}#;/Objects/a", "SUBSCRIBE", 0, 1, "expected a CLIENT"),
        (f"CREATE_METHOD;{SERVER}#;/Objects/a", "SERVER", 1, 1, "with an endpoint: expected READ, WRITE"),
        ("SUBSCRIBE;/Objects/a", "SUBSCRIBE", 0, 1, "without an endpoint: expected READ, WRITE"),
        (f"CALL_METHOD;{SERVER}#;,1:i=2", "CLIENT", 1, 1, "expected a CLIENT with the path of one method"),
        ("READ;http://h#;/Objects/a", "SUBSCRIBE", 0, 1, "expected opc.tcp://HOST:PORT"),
        ("READ;Objects/a", "SUBSCRIBE", 0, 1, "expected /Objects/NAME"),
        ("READ;/Objects/1:a:b", "SUBSCRIBE", 0, 1, "is no NAME or NAMESPACE:NAME"),
        ("READ;/Objects/70000:a", "SUBSCRIBE", 0, 1, "is no NAME or NAMESPACE:NAME"),
        ("READ;/", "SUBSCRIBE", 0, 1, "expected /Objects/NAME"),
        ("READ;,1:g=12", "SUBSCRIBE", 0, 1, "expected NAMESPACE:i=NUMBER, s=TEXT or b=BYTES"),
        ("READ;,1:i=99999999999", "SUBSCRIBE", 0, 1, "expected a number from 0 to 4294967295"),
        ("READ;/Objects/a,1:i=2,3", "SUBSCRIBE", 0, 1, "expected PATH,NODE"),
        ("READ;", "SUBSCRIBE", 0, 0, "expected PATH,NODE"),
        ("READ;" + "/a" * 3000, "SUBSCRIBE", 0, 1, "expected at most 4096"),
    ],
)
def test_what_is_no_action_is_told(text: str, kind: str, sends: int, receives: int, complaint: str) -> None:
    with pytest.raises(CommunicationError) as caught:
        parse_action(text, kind, sends, receives)
    assert complaint in str(caught.value)


def test_the_identifiers_of_the_page_are_read() -> None:
    (block,) = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)
    read, write = (parse_layers(line)[0].parameters for line in block.splitlines())
    assert parse_action(read, "SUBSCRIBE", 0, 1).name == "READ"
    assert parse_action(write, "CLIENT", 1, 0).endpoint == "opc.tcp://127.0.0.1:4840"


def test_the_settings_of_the_page_are_read(tmp_path: Path) -> None:
    (block,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    for name in ("own.der", "own.pem", "their.der"):
        (tmp_path / name).touch()
    (tmp_path / "trusted").mkdir()
    file = tmp_path / "connections.toml"
    file.write_text(block)
    found = read_connections(file)
    assert found.opcua.trusted == (str(tmp_path / "trusted"),)
    assert found.peer_at("opc.tcp://10.0.0.5:4840").key == str(tmp_path / "own.pem")
    assert found.peer_at("tcp://elsewhere:1883") == Peer("tcp://elsewhere:1883")
