"""The embedded runtime as a device: managed over TCP, in real time, beside hostile peers."""

from __future__ import annotations

import os
import random
import re
import socket
import subprocess
import threading
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import Any

import pytest

from dtwin.controller.ports import EMULATOR
from dtwin.errors import CommunicationError, FunctionBlockError
from dtwin.iec61499.device.embedded import EmbeddedDevice
from dtwin.iec61499.device.managed_resource import WATCHES
from dtwin.iec61499.library import Library
from dtwin.iec61499.management.bootfile import parse_boot_file
from dtwin.iec61499.management.client import ManagementClient
from dtwin.iec61499.management.protocol import (
    REQUESTS,
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    ManagementError,
    RequestAction,
    Subject,
    Watch,
)
from dtwin.iec61499.management.server import CLIENTS, ManagementServer
from dtwin.iec61499.mapping import resource_network
from dtwin.iec61499.net.address import LOOPBACK, Address
from dtwin.iec61499.net.client import BlockingClient
from dtwin.iec61499.net.reactor import Reactor
from dtwin.iec61499.net.wire import Signature
from dtwin.iec61499.runtime.resource import Resource
from dtwin.iec61499.types import BOOL, LREAL
from dtwin.parameters import ROOT

PATIENCE = 10.0
ANY_PORT = Address(LOOPBACK, 0)
NUMBER = Signature([LREAL])

DOUBLER = """<?xml version="1.0" encoding="UTF-8"?>
<FBType Name="DOUBLER" Comment="">
  <Identification Standard="61499-2"/>
  <VersionInfo Version="1.0"/>
  <InterfaceList>
    <EventInputs><Event Name="REQ"><With Var="X"/></Event></EventInputs>
    <EventOutputs><Event Name="CNF"><With Var="Y"/></Event></EventOutputs>
    <InputVars><VarDeclaration Name="X" Type="LREAL"/></InputVars>
    <OutputVars><VarDeclaration Name="Y" Type="LREAL"/></OutputVars>
  </InterfaceList>
  <BasicFB>
    <ECC>
      <ECState Name="START" x="0" y="0"/>
      <ECState Name="DO" x="0" y="0"><ECAction Algorithm="DOUBLE" Output="CNF"/></ECState>
      <ECTransition Source="START" Destination="DO" Condition="REQ" x="0" y="0"/>
      <ECTransition Source="DO" Destination="START" Condition="1" x="0" y="0"/>
    </ECC>
    <Algorithm Name="DOUBLE"><ST><![CDATA[Y := 2.0 * X;]]></ST></Algorithm>
  </BasicFB>
</FBType>
"""


class Served:
    """A device with its management, run by a thread of its own."""

    def __init__(self, library: Library) -> None:
        self.reactor = Reactor()
        self.library = library
        self.device = EmbeddedDevice(self.reactor, library)
        self.management = ManagementServer(self.reactor, ANY_PORT, self.device.handle)
        self._thread = threading.Thread(target=self.reactor.run)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self.reactor.stop()
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()
        self.management.close()
        self.device.close()
        self.reactor.close()

    def client(self) -> ManagementClient:
        return ManagementClient(self.management.address, PATIENCE)

    def connect(self, block: str) -> BlockingClient:
        return BlockingClient(self.device.addresses()[block], NUMBER, NUMBER, PATIENCE)


@pytest.fixture
def library(tmp_path: Path) -> Library:
    (tmp_path / "DOUBLER.fbt").write_text(DOUBLER)
    return Library([tmp_path])


@pytest.fixture
def served(library: Library) -> Iterator[Served]:
    served = Served(library)
    served.start()
    yield served
    served.stop()


def wait_for(client: ManagementClient, resource: str, name: str, condition: Callable[[str], bool]) -> str:
    deadline = time.monotonic() + PATIENCE
    while not condition(value := client.read(resource, name)):
        assert time.monotonic() < deadline, f"{name} is still {value}"
    return value


def build(client: ManagementClient, resource: str, steps: str) -> None:
    """Creates a resource; a step is `NAME TYPE [PORT=LITERAL ...]` or `SOURCE -> DESTINATION`."""
    client.create_block("", resource, "EMB_RES")
    for step in steps.strip().splitlines():
        source, arrow, destination = step.partition("->")
        if arrow:
            client.connect(resource, source.strip(), destination.strip())
            continue
        name, kind, *parameters = step.split()
        client.create_block(resource, name, kind)
        for parameter in parameters:
            port, _, literal = parameter.partition("=")
            client.write(resource, f"{name}.{port}", literal)


DOUBLING = """
S SERVER_1_1 QI=1 ID="localhost:0"
D DOUBLER
START.COLD -> S.INIT
START.WARM -> S.INIT
S.IND -> D.REQ
D.CNF -> S.RSP
S.RD_1 -> D.X
D.Y -> S.SD_1
"""

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


FORTE = os.environ.get("FORTE", "")
NEEDS_FORTE = pytest.mark.skipif(not FORTE, reason="set FORTE to the path of a 4diac FORTE binary to run this")


def free_address() -> Address:
    with socket.socket() as probe:
        probe.bind(ANY_PORT)
        return Address(*probe.getsockname())


def started(address: Address) -> ManagementClient:
    deadline = time.monotonic() + PATIENCE
    while True:
        try:
            return ManagementClient(address, PATIENCE)
        except CommunicationError:
            assert time.monotonic() < deadline


@pytest.fixture(params=["embedded", pytest.param("forte", marks=NEEDS_FORTE)])
def either(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[ManagementClient]:
    """A management session with the embedded device, then with a 4diac FORTE."""
    if request.param == "embedded":
        with request.getfixturevalue("served").client() as client:
            yield client
        return
    address = free_address()
    with (tmp_path / "forte.log").open("w") as log:
        command = [FORTE, "-c", f"localhost:{address.port}"]
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, cwd=tmp_path)
        try:
            with started(address) as client:
                yield client
        finally:
            # a FORTE that has killed a resource no longer ends on SIGTERM
            process.kill()
            process.wait(PATIENCE)


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


def test_the_number_of_watches_is_bounded(served: Served) -> None:
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


def test_an_application_built_over_management_serves(served: Served) -> None:
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
        connections = client.demand("R", "QUERY", ManagedConnection("*", "*")).connections
        assert connections is not None
        assert ManagedConnection("S.RD_1", "D.X") in connections
        assert "DOUBLER" in (client.demand("", "QUERY", ManagedType("*")).names or ())


def test_unlike_types_are_not_connected(served: Served) -> None:
    with served.client() as client:
        build(client, "R", "D DOUBLER\nF E_D_FF")
        with pytest.raises(ManagementError, match=r"refused CREATE D\.Y -> F\.D: INVALID_OPERATION"):
            client.connect("R", "D.Y", "F.D")


def test_what_the_library_knows_may_be_sent_as_lua(served: Served) -> None:
    with served.client() as client:
        client.create_type("", "DOUBLER", "any text")
        with pytest.raises(ManagementError, match="refused CREATE FBType TRIPLER: UNSUPPORTED_TYPE"):
            client.create_type("", "TRIPLER", "any text")


def test_stop_start_kill_and_reset(served: Served) -> None:
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


def test_cycles_run_on_the_clock(served: Served) -> None:
    period = 0.005
    with served.client() as client:
        build(client, "R", "C E_CYCLE DT=T#5ms\nN E_CTU PV=1000\nSTART.COLD -> C.START\nC.EO -> N.CU")
        client.start("R")
        begin = time.monotonic()
        first = int(client.read("R", "N.CV"))
        last = int(wait_for(client, "R", "N.CV", lambda value: int(value) >= first + 10))
        elapsed = time.monotonic() - begin
        assert elapsed > (last - first - 1) * period
        client.stop("R")
        stopped = client.read("R", "N.CV")
        client.start("R")
        assert client.read("R", "N.CV") == stopped


def test_blocks_of_two_resources_meet_in_process_and_over_udp(served: Served) -> None:
    address = free_address()
    with served.client() as client:
        build(
            client,
            "RECEIVER",
            f"""
            L SUBL_1 QI=1 ID=link
            U SUBSCRIBE_1 QI=1 ID={address}
            DL DOUBLER
            DU DOUBLER
            START.COLD -> L.INIT
            L.INITO -> U.INIT
            L.IND -> DL.REQ
            U.IND -> DU.REQ
            L.RD_1 -> DL.X
            U.RD_1 -> DU.X
            """,
        )
        client.start("RECEIVER")
        build(
            client,
            "SENDER",
            f"""
            D DOUBLER X=1.5
            L PUBL_1 QI=1 ID=link
            U PUBLISH_1 QI=1 ID={address}
            START.COLD -> L.INIT
            L.INITO -> U.INIT
            U.INITO -> D.REQ
            D.CNF -> L.REQ
            L.CNF -> U.REQ
            D.Y -> L.SD_1
            D.Y -> U.SD_1
            """,
        )
        client.start("SENDER")
        for block in ("DL", "DU"):
            assert wait_for(client, "RECEIVER", f"{block}.Y", lambda value: value != "0.0") == "6.0"


def test_a_client_block_calls_a_server_block(served: Served) -> None:
    with served.client() as client:
        build(client, "SERVER", DOUBLING)
        client.start("SERVER")
        build(
            client,
            "CALLER",
            f"""
            D DOUBLER X=1.5
            C CLIENT_1_1 QI=1 ID={served.device.addresses()["S"]}
            E DOUBLER
            START.COLD -> C.INIT
            C.INITO -> D.REQ
            D.CNF -> C.REQ
            C.CNF -> E.REQ
            D.Y -> C.SD_1
            C.RD_1 -> E.X
            """,
        )
        client.start("CALLER")
        assert wait_for(client, "CALLER", "E.Y", lambda value: value != "0.0") == "12.0"
        client.kill("SERVER")
        assert wait_for(client, "CALLER", "C.STATUS", lambda value: value != "OK") == "TERMINATED"


@pytest.mark.parametrize("identifier", ["nowhere", "127.0.0.1:1", "127.0.0.1:99999"])
def test_a_client_that_cannot_connect_says_so(served: Served, identifier: str) -> None:
    with served.client() as client:
        build(client, "R", f"C CLIENT_0 QI=1 ID={identifier}\nSTART.COLD -> C.INIT")
        client.start("R")
        assert wait_for(client, "R", "C.STATUS", bool) == "INVALID_ID"
        assert client.read("R", "C.QO") == "FALSE"


def test_an_endless_loop_ends_its_resource_only(served: Served, caplog: pytest.LogCaptureFixture) -> None:
    with served.client() as client:
        build(client, "GOOD", DOUBLING)
        client.start("GOOD")
        build(client, "BAD", "D DOUBLER\nSTART.COLD -> D.REQ\nD.CNF -> D.REQ")
        client.start("BAD")
        assert client.request("BAD", "STOP").reason == "INVALID_STATE"
        with served.connect("S") as peer:
            assert peer.exchange([1.0]) == (2.0,)
    messages = [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]
    assert len(messages) == 1
    assert "resource BAD ended: " in messages[0]
    assert "endless loop of events: D.REQ" in messages[0]


BOOT = """;<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>
R;<Request ID="2" Action="CREATE"><FB Name="C" Type="E_CYCLE" /></Request>
R;<Request ID="3" Action="WRITE"><Connection Source="T#1ms" Destination="C.DT" /></Request>
R;<Request ID="4" Action="CREATE"><Connection Source="START.COLD" Destination="C.START" /></Request>
R;<Request ID="5" Action="START"/>
"""


def test_a_boot_file_is_carried_out(served: Served) -> None:
    served.device.load_commands(parse_boot_file(BOOT))
    with served.client() as client:
        assert client.read("R", "C.DT") == "T#1ms"


def test_a_refused_boot_command_names_its_line(served: Served) -> None:
    commands = parse_boot_file(BOOT.replace("T#1ms", "often"))
    with pytest.raises(FunctionBlockError, match=r"^app\.fboot:3: WRITE often to C\.DT refused: BAD_PARAMS"):
        served.device.load_commands(commands, "app.fboot")


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Served]:
    """The control application of the cell, on a port the system chooses."""
    library = Library([ROOT / "fb"])
    system = tmp_path / "cell.sys"
    system.write_text(re.sub(r"localhost:615\d\d", "localhost:0", (ROOT / "fb" / "dtwin.sys").read_text()))
    served = Served(library)
    served.device.load_system(library.load_system(system))
    served.start()
    yield served
    served.stop()


def samples(count: int) -> list[tuple[Any, ...]]:
    rng = random.Random(11)
    walk = [0.0, 0.0, 0.0]
    result = []
    for k in range(count):
        walk = [angle + rng.uniform(-0.01, 0.01) for angle in walk]
        present = k % 400 > 100
        colour = ("red", "green", "blue")[k // 400 % 3]
        result.append((*walk, 0.9 - 0.001 * (k % 500), present, colour if present else ""))
    return result


def test_served_answers_are_those_of_the_resource_in_process(cell: Served) -> None:
    system = cell.library.load_system(ROOT / "fb" / "dtwin.sys")
    resource = Resource(resource_network(system), cell.library)
    server = resource.server("EMULATOR")
    resource.start()
    with BlockingClient(cell.device.addresses()["EMULATOR"], EMULATOR.receives, EMULATOR.sends, PATIENCE) as peer:
        for sample in samples(2000):
            assert peer.exchange(sample) == server.exchange(sample)


def test_round_trip_of_a_control_tick(cell: Served) -> None:
    durations = []
    with BlockingClient(cell.device.addresses()["EMULATOR"], EMULATOR.receives, EMULATOR.sends, PATIENCE) as peer:
        for sample in samples(1500):
            begin = time.perf_counter()
            peer.exchange(sample)
            durations.append(time.perf_counter() - begin)
    assert median(durations) < 250e-6


@contextmanager
def hostile(address: Address, count: int) -> Iterator[list[socket.socket]]:
    """Connections that are closed in the end; writing to one that the device has dropped is no error."""
    sockets = [socket.create_connection(address, PATIENCE) for _ in range(count)]
    try:
        yield sockets
    finally:
        for sock in sockets:
            sock.close()


def drain(sock: socket.socket) -> None:
    """Reads until the peer closes."""
    sock.settimeout(PATIENCE)
    with suppress(ConnectionResetError):
        while sock.recv(65536):
            pass


def send(sock: socket.socket, data: bytes) -> None:
    with suppress(ConnectionResetError, BrokenPipeError):
        sock.sendall(data)


def message(resource: bytes, request: bytes) -> bytes:
    return REQUESTS.encode([resource.decode("latin-1"), request.decode("latin-1")])


def mutants(rng: random.Random, count: int) -> Iterator[bytes]:
    """Valid requests with bytes changed, cut out, doubled or put in, and plain noise."""
    lines = [line.partition(";") for line in BOOT.splitlines()]
    valid = [message(resource.encode(), request.encode()) for resource, _, request in lines]
    for _ in range(count):
        data = bytearray(rng.choice(valid))
        for _ in range(rng.randrange(1, 6)):
            at = rng.randrange(len(data) + 1)
            piece = rng.randbytes(rng.randrange(0, 4))
            data[at : at + rng.randrange(0, 8)] = piece
        yield rng.choice([bytes(data), rng.randbytes(rng.randrange(1, 100))])


def test_fuzzed_management_does_no_harm(cell: Served) -> None:
    rng = random.Random(17)
    for data in mutants(rng, 300):
        with hostile(cell.management.address, 1) as (sock,):
            for begin in range(0, len(data), 50):
                send(sock, data[begin : begin + 50])
            with suppress(OSError):
                sock.shutdown(socket.SHUT_WR)
            drain(sock)
    with cell.client() as client:
        assert client.read("EMB_RES", "EMULATOR.STATUS") == "OK"


XML_BOMB = (
    b'<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">'
    + b"".join(b'<!ENTITY %c "%s">' % (98 + i, b"&%c;" % (97 + i) * 10) for i in range(20))
    + b']><Request ID="1" Action="START"><FB Name="&u;" Type=""/></Request>'
)


@pytest.mark.parametrize(
    "request_",
    [
        XML_BOMB,
        b'<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><Request ID="1" Action="START">&a;</Request>',
        b"<a>" * 20_000,
        b'<Request ID="1" Action="START">' + b"\xff\xfe\x00" * 100,
        b"",
    ],
)
def test_hostile_xml_is_refused(served: Served, request_: bytes, caplog: pytest.LogCaptureFixture) -> None:
    with hostile(served.management.address, 1) as (sock,):
        send(sock, message(b"", request_))
        answer = sock.recv(1000)
    assert b'Reason="INVALID_OBJECT"' in answer
    assert len(caplog.records) == 1
    with served.client() as client:
        assert client.blocks("") == ()


def test_a_hundred_silent_clients_on_every_port_keep_nobody_out(
    cell: Served, caplog: pytest.LogCaptureFixture
) -> None:
    emulator = cell.device.addresses()["EMULATOR"]
    with hostile(cell.management.address, 100) as managers, hostile(emulator, 100) as clients:
        for sock in managers[:50] + clients[:50]:
            send(sock, b"\x50")
        with cell.client() as client, BlockingClient(emulator, EMULATOR.receives, EMULATOR.sends, PATIENCE) as peer:
            for sample in samples(50):
                assert len(peer.exchange(sample)) == 5
            assert client.read("EMB_RES", "EMULATOR.STATUS") == "OK"
        for sock in clients:
            drain(sock)
        for sock in managers[: 100 - CLIENTS]:
            drain(sock)
    # a wrong first byte, or silence while too many wait: one line each
    assert len(caplog.records) <= 100 + 101 - CLIENTS
    assert len({record.getMessage() for record in caplog.records}) == len(caplog.records)


def test_memory_stays_bounded_under_unfinished_requests(served: Served) -> None:
    unfinished = message(b"", b"x" * 65000)[:-1]
    with served.client() as client:
        client.blocks("")
        tracemalloc.start()
        for _ in range(3):
            with hostile(served.management.address, 2 * CLIENTS) as sockets:
                for sock in sockets:
                    send(sock, unfinished)
                assert client.blocks("") == ()
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < 4 * CLIENTS * len(unfinished)


def test_requests_may_come_split_and_joined(served: Served) -> None:
    create = message(b"", b'<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>')
    query = message(b"", b'<Request ID="2" Action="QUERY"><FB Name="*" Type="*" /></Request>')
    with hostile(served.management.address, 1) as (sock,):
        stream = create + query
        for begin in range(0, len(stream), 7):
            send(sock, stream[begin : begin + 7])
        answers = b""
        while b"FBList>" not in answers[-20:] and b'name="R"' not in answers:
            answers += sock.recv(1000)
    assert answers.startswith(b'\x50\x00\x13<Response ID="1" />')
