"""Management carried out: an embedded device and a 4diac FORTE give the same answers."""

from __future__ import annotations

import socket

import pytest

from dtwin.errors import CommunicationError
from iec61499.device.managed_resource import WATCHES
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import (
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    ManagementError,
    RequestAction,
    Subject,
    Watch,
)
from iec61499.net.client import BlockingClient
from iec61499.net.wire import Signature
from iec61499.types import BOOL
from tests.support.iec61499.hostile import drain
from tests.support.iec61499.served_device import (
    DOUBLING,
    NUMBER,
    PATIENCE,
    ServedDevice,
    build,
    free_address,
    wait_for,
)

R = ManagedBlock("R", "EMB_RES")
TRANSCRIPT: list[tuple[str, RequestAction, Subject | None, str | None]] = [
    ("", "CREATE", R, None),
    ("", "CREATE", R, "INVALID_STATE"),
    ("", "CREATE", ManagedBlock("Q", "NOPE"), "UNSUPPORTED_TYPE"),
    ("Q", "CREATE", ManagedBlock("X", "E_SR"), "INVALID_DST"),
    ("R", "CREATE", ManagedBlock("X", "NOPE"), "UNSUPPORTED_TYPE"),
    ("R", "CREATE", ManagedBlock("C", "E_CYCLE"), None),
    ("R", "CREATE", ManagedBlock("C", "E_CYCLE"), "INVALID_STATE"),
    ("R", "CREATE", ManagedBlock("N", "E_CTU"), None),
    ("R", "CREATE", ManagedBlock("F", "E_D_FF"), None),
    ("R", "CREATE", ManagedConnection("START.COLD", "C.START"), None),
    ("R", "CREATE", ManagedConnection("START.COLD", "C.START"), "INVALID_STATE"),
    ("R", "CREATE", ManagedConnection("START.COLDER", "C.START"), "NO_SUCH_OBJECT"),
    ("R", "CREATE", ManagedConnection("START.COLD", "C.STARTLE"), "NO_SUCH_OBJECT"),
    ("R", "CREATE", ManagedConnection("START.COLD", "X.START"), "NO_SUCH_OBJECT"),
    ("R", "CREATE", ManagedConnection("C.EO", "N.CU"), None),
    ("R", "CREATE", ManagedConnection("N.Q", "F.D"), None),
    ("R", "CREATE", ManagedConnection("N.CV", "F.D"), "INVALID_STATE"),
    ("R", "CREATE", ManagedConnection("F.Q", "F.D"), "INVALID_STATE"),
    ("R", "DELETE", ManagedConnection("N.Q", "F.D"), None),
    ("R", "DELETE", ManagedConnection("N.Q", "F.D"), "INVALID_STATE"),
    ("R", "DELETE", ManagedBlock("F", ""), None),
    ("R", "DELETE", ManagedBlock("F", ""), "NO_SUCH_OBJECT"),
    ("R", "WRITE", ManagedConnection("T#1500us", "C.DT"), None),
    ("R", "WRITE", ManagedConnection("soon", "C.DT"), "BAD_PARAMS"),
    ("R", "WRITE", ManagedConnection("1", "C.DX"), "NO_SUCH_OBJECT"),
    ("R", "WRITE", ManagedConnection("65536", "N.PV"), "BAD_PARAMS"),
    ("R", "WRITE", ManagedConnection("65535", "N.PV"), None),
    ("R", "READ", ManagedConnection("N.PV", "*"), None),
    ("R", "READ", ManagedConnection("N.PX", "*"), "NO_SUCH_OBJECT"),
    ("R", "READ", ManagedConnection("X.PV", "*"), "NO_SUCH_OBJECT"),
    ("R", "CREATE", Watch("N.PV"), None),
    ("R", "CREATE", Watch("N.PV"), None),
    ("R", "CREATE", Watch("N.PX"), "NO_SUCH_OBJECT"),
    ("R", "READ", Watch(), None),
    ("R", "DELETE", Watch("N.PV"), None),
    ("R", "DELETE", Watch("N.CV"), "NO_SUCH_OBJECT"),
    ("R", "STOP", None, "INVALID_STATE"),
    ("R", "RESET", None, "INVALID_STATE"),
    ("R", "START", None, None),
    ("R", "START", None, "INVALID_STATE"),
    ("", "DELETE", R, "INVALID_STATE"),
    ("R", "READ", ManagedConnection("N.CV", "*"), None),
    ("R", "STOP", None, None),
    ("R", "STOP", None, "INVALID_STATE"),
    ("R", "START", None, None),
    ("", "KILL", R, None),
    ("R", "START", None, "INVALID_STATE"),
    ("R", "RESET", None, None),
    ("", "DELETE", R, None),
    ("", "DELETE", R, "NO_SUCH_OBJECT"),
    ("", "START", None, "INVALID_STATE"),
]


def replay(client: ManagementClient) -> None:
    for step in TRANSCRIPT:
        resource, action, subject, reason = step
        response = client.request(resource, action, subject)
        assert response.reason == reason, step
    assert client.request("", "CREATE", ManagedType("NOPE", "no Lua")).reason in (
        "UNSUPPORTED_TYPE",
        "INVALID_OPERATION",
    )


def test_both_devices_give_the_same_reasons(either: ManagementClient) -> None:
    replay(either)


def test_both_devices_serve_the_same_wire(either: ManagementClient) -> None:
    address = free_address()
    build(
        either,
        "R",
        f"""
        S SERVER_1_1 QI=1 ID={address}
        F E_D_FF
        START.COLD -> S.INIT
        S.IND -> F.CLK
        F.EO -> S.RSP
        S.RD_1 -> F.D
        F.Q -> S.SD_1
        """,
    )
    either.start("R")
    wait_for(either, "R", "S.STATUS", lambda status: status == "OK")
    boolean = Signature([BOOL])
    with BlockingClient(address, boolean, boolean, PATIENCE) as peer:
        for k in range(100):
            assert peer.exchange([k % 2 == 0]) == (k % 2 == 0,)
        with socket.create_connection(address, PATIENCE) as second:
            drain(second)
        assert peer.exchange([True]) == (True,)
    assert either.read("R", "F.Q") == "TRUE"


@pytest.mark.parametrize(
    ("literal", "shown"),
    [
        ("'a$00b'", "'a$00b'"),
        ("'a$01b'", "'a$01b'"),
        ("'a$Lb'", "'a$Nb'"),
        ("'$R$T$P$7F'", "'$R$T$P$7F'"),
        ("'a$C3$28b'", "'a$C3(b'"),
        ("'$'a$''", "'$'a$''"),
        ("'a$$b $'c$' \"d\" <&>'", "a$b 'c' \"d\" <&>"),
        ("'Größe €'", "Größe €"),
        ("STRING#'typed'", "typed"),
        ("STRING#bare", "bare"),
        ("'STRING#x'", "'STRING#x'"),
        ("''", ""),
    ],
)
def test_a_text_reads_back(served: ServedDevice, literal: str, shown: str) -> None:
    with served.client() as client:
        build(client, "R", "T STRING2STRING\nW WSTRING2WSTRING\nSTART.COLD -> T.REQ")
        client.start("R")
        client.watch("R", "T.IN")
        for _ in range(2):
            client.write("R", "T.IN", literal)
            literal = client.read("R", "T.IN")
            assert literal == shown
            assert client.watched("R") == {"T.IN": shown}
        client.write("R", "W.IN", '"a$000A$0000"')
        assert client.read("R", "W.IN") == '"a$N$0000"'


def test_both_devices_tell_watched_ports_at_once(either: ManagementClient) -> None:
    build(either, "R", "N E_CTU PV=7\nF E_D_FF\nSTART.COLD -> N.CU\nN.Q -> F.D")
    assert either.watched("R") == {}
    for name in ("N.PV", "N.CV", "F.D"):
        either.watch("R", name)
    either.start("R")
    wait_for(either, "R", "N.CV", lambda value: value == "1")
    assert either.watched("R") == {"N.PV": "7", "N.CV": "1", "F.D": "FALSE"}
    either.demand("R", "DELETE", Watch("N.PV"))
    assert either.watched("R") == {"N.CV": "1", "F.D": "FALSE"}


def test_the_number_of_watches_is_bounded(served: ServedDevice) -> None:
    with served.client() as client:
        client.create_block("", "R", "EMB_RES")
        for number in range(WATCHES + 1):
            client.create_block("R", f"N{number}", "E_CTU")
        for number in range(WATCHES):
            client.watch("R", f"N{number}.PV")
        with pytest.raises(ManagementError, match=f"N{WATCHES}.PV: OVERFLOW"):
            client.watch("R", f"N{WATCHES}.PV")
        client.watch("R", "N0.PV")
        client.delete_block("R", "N0")
        assert len(client.watched("R")) == WATCHES - 1


def test_an_application_built_over_management_serves(served: ServedDevice) -> None:
    with served.client() as client:
        build(client, "R", DOUBLING)
        assert served.device.addresses() == {}
        client.start("R")
        with served.connect("S") as peer:
            assert peer.exchange([1.25]) == (2.5,)
            assert client.read("R", "D.Y") == "2.5"
            assert client.read("R", "S.STATUS") == "OK"
            client.write("R", "S.QI", "FALSE")
            assert client.read("R", "S.QI") == "FALSE"
        assert [block.name for block in client.blocks("R")] == ["START", "S", "D"]
        assert client.blocks("") == (R,)
        links = client.demand("R", "QUERY", ManagedConnection("*", "*")).connections
        assert links is not None
        assert ManagedConnection("S.RD_1", "D.X") in links
        assert "DOUBLER" in (client.demand("", "QUERY", ManagedType("*")).names or ())


def test_unlike_types_are_not_connected(served: ServedDevice) -> None:
    with served.client() as client:
        build(client, "R", "D DOUBLER\nF E_D_FF")
        with pytest.raises(ManagementError, match=r"refused CREATE D\.Y -> F\.D: INVALID_OPERATION"):
            client.connect("R", "D.Y", "F.D")


def test_what_the_library_knows_may_be_sent_as_lua(served: ServedDevice) -> None:
    with served.client() as client:
        client.create_type("", "DOUBLER", "any text")
        with pytest.raises(ManagementError, match="refused CREATE FBType TRIPLER: UNSUPPORTED_TYPE"):
            client.create_type("", "TRIPLER", "any text")


def test_stop_start_kill_and_reset(served: ServedDevice) -> None:
    with served.client() as client:
        build(client, "R", DOUBLING)
        client.start("R")
        address = served.device.addresses()["S"]
        with BlockingClient(address, NUMBER, NUMBER, 0.05) as peer:
            client.stop("R")
            with pytest.raises(CommunicationError, match="no answer"):
                peer.exchange([1.0])
        client.start("R")
        with served.connect("S") as peer:
            assert peer.exchange([1.0]) == (2.0,)
            client.kill("R")
            with pytest.raises(CommunicationError, match="connection lost"):
                peer.exchange([1.0])
        assert served.device.addresses() == {}
        client.demand("R", "RESET")
        client.start("R")
        with served.connect("S") as peer:
            assert peer.exchange([3.0]) == (6.0,)
