"""Whatever a port of the device receives, the answer is a value or an error to its sender, and the device goes on."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from typing import NoReturn

import pytest

from iec61499.device.managed_resource import ManagedResource
from iec61499.files.block_types import read_type
from iec61499.library import Library
from iec61499.management.protocol import ManagedConnection
from iec61499.net.address import Address
from iec61499.net.encoding import NULL
from iec61499.net.reactor import Reactor
from iec61499.net.wire import Signature
from iec61499.runtime.compile import compiled
from iec61499.st.python.helpers import FAST
from iec61499.st.semantics import COMPUTING_TIME
from iec61499.types import STRING
from tests.iec61499.conftest import DOUBLER
from tests.support.iec61499.served_device import DOUBLING, ServedDevice, build, free_address, wait_for
from tests.support.waiting import until

LONG = "9" * 5000
LABEL = DOUBLER.replace("DOUBLER", "LABEL").replace("LREAL", "WSTRING").replace("2.0 * X", "X")


@pytest.fixture
def library(tmp_path: Path) -> Library:
    for name, text in {"LABEL": LABEL, "DOUBLER": DOUBLER}.items():
        (tmp_path / f"{name}.fbt").write_text(text)
    return Library([tmp_path])


@pytest.fixture
def good(served: ServedDevice) -> Iterator[ServedDevice]:
    """A device with a resource that has to go on: it doubles numbers."""
    with served.client() as client:
        build(client, "GOOD", DOUBLING)
        client.start("GOOD")
    yield served
    with served.connect("S") as peer:
        assert peer.exchange([1.0]) == (2.0,)


@pytest.mark.parametrize("started", [False, True])
@pytest.mark.parametrize(
    ("port", "literal"),
    [
        ("N.PV", LONG),
        ("N.PV", "-" + LONG),
        ("N.PV", "INT#" + LONG),
        ("D.DT", f"T#{LONG}s"),
        ("D.DT", f"T#{LONG}.{LONG}s"),
        ("X.X", f"LREAL#{LONG}"),
        ("X.X", "1e" + LONG),
        ("T.DT", f"[{LONG}(T#1s)]"),
        ("T.DT", f"[2({LONG}(T#1s))]"),
        ("T.DT", "[" * 5000),
        ("T.DT", "(" * 5000),
        ("L.X", '"$D800"'),
        ("L.X", '"$DC00$D800"'),
    ],
)
def test_a_literal_is_refused_with_an_answer(good: ServedDevice, started: bool, port: str, literal: str) -> None:
    with good.client() as client:
        build(client, "R", "N E_CTU\nD E_DELAY\nT E_TABLE\nL LABEL\nX DOUBLER")
        if started:
            client.start("R")
        before = client.read("R", port)
        assert client.request("R", "WRITE", ManagedConnection(literal, port)).reason == "BAD_PARAMS"
        assert client.read("R", port) == before


def test_pairs_of_surrogates_are_one_character(good: ServedDevice) -> None:
    with good.client() as client:
        build(client, "R", "L LABEL")
        client.write("R", "L.X", '"$D83D$DE00"')
        assert client.read("R", "L.X") == "\N{GRINNING FACE}"


@pytest.mark.parametrize(
    ("blocks", "text"),
    [
        ("F F_STRING_TO_INT", LONG),
        ("F F_STRING_TO_INT", "-" + LONG),
        ("F F_STRING_TO_LREAL", LONG),
        ("F F_STRING_TO_LREAL", "1e" + LONG),
        ("F F_STRING_TO_TIME\nD E_DELAY\nF.CNF -> D.START\nF.OUT -> D.DT", f"T#{'9' * 400}s"),
        ("F F_STRING_TO_TIME\nD E_CYCLE\nF.CNF -> D.START\nF.OUT -> D.DT", f"T#-{'9' * 400}s"),
        ("F F_STRING_TO_TIME\nD F_TIME_TO_STRING\nF.CNF -> D.REQ\nF.OUT -> D.IN", f"T#{LONG}d"),
    ],
)
def test_a_datagram_with_long_numbers_leaves_the_device_alive(good: ServedDevice, blocks: str, text: str) -> None:
    address = free_address()
    with good.client() as client, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        first, *rest = blocks.split("\n")
        wires = "START.COLD -> U.INIT\nU.IND -> F.REQ\nU.RD_1 -> F.IN\nU.IND -> N.CU"
        build(client, "R", "\n".join([first, f"U SUBSCRIBE_1 QI=1 ID={address}", "N E_CTU PV=9", *rest, wires]))
        client.start("R")
        sender.sendto(Signature([STRING]).encode([text]), address)
        wait_for(client, "R", "N.CV", lambda value: value == "1")


STALLS = {
    "LOOP": DOUBLER.replace("DOUBLER", "LOOP").replace("Y := 2.0 * X;", "WHILE TRUE DO Y := X; END_WHILE;"),
    "GROW": DOUBLER.replace("DOUBLER", "GROW")
    .replace("LREAL", "STRING")
    .replace("Y := 2.0 * X;", "Y := 'x'; WHILE Y <> '' DO Y := CONCAT(Y, Y); Y := INSERT(Y, Y, 0); END_WHILE;"),
    "COPY": DOUBLER.replace("DOUBLER", "COPY")
    .replace('Name="Y" Type="LREAL"', 'Name="Y" Type="LREAL" ArraySize="20000"')
    .replace("Y := 2.0 * X;", "WHILE TRUE DO Y := Z; Z := Y; END_WHILE;")
    .replace("<BasicFB>", '<BasicFB><InternalVars><VarDeclaration Name="Z" Type="LREAL" ArraySize="20000"/>'
             "</InternalVars>"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("steps", "event"),
    [
        ("D LOOP\nSTART.COLD -> D.REQ", "D.REQ"),
        ("D GROW\nSTART.COLD -> D.REQ", "D.REQ"),
        ("D COPY\nSTART.COLD -> D.REQ", "D.REQ"),
        ("S E_SPLIT\nSTART.COLD -> S.EI\nS.EO1 -> S.EI\nS.EO2 -> S.EI", "S.EI"),
        ("S E_SPLIT_254\nSTART.COLD -> S.EI\n" + "\n".join(f"S.EO{i} -> S.EI" for i in range(1, 255)), "S.EI"),
        ("S E_SWITCH\nSTART.COLD -> S.EI\nS.EO0 -> S.EI", "S.EI"),
    ],
)
def test_a_chain_without_end_ends_its_resource_and_stalls_no_other(
    served: ServedDevice, tmp_path: Path, caplog: pytest.LogCaptureFixture, steps: str, event: str
) -> None:
    for name, text in STALLS.items():
        path = tmp_path / f"{name}.fbt"
        path.write_text(text)
        served.library.add(read_type(path))
    with served.client() as client:
        build(client, "BAD", steps.replace("START.COLD", "W E_DELAY DT=T#200ms\nSTART.COLD -> W.START\nW.EO"))
        client.start("BAD")
        late = Lateness(served.reactor)
        before = getrusage(RUSAGE_SELF).ru_maxrss
        until(lambda: "resource BAD ended: " in caplog.text, "the resource has ended")
        assert client.request("BAD", "STOP").reason == "INVALID_STATE"
    assert event in caplog.text.partition("resource BAD ended: ")[2]
    assert late.longest < 2 * COMPUTING_TIME
    assert getrusage(RUSAGE_SELF).ru_maxrss - before < 40_000  # KiB


class Lateness:
    """Longest time of the processor that others take between two rings of a timer of 1 ms."""

    def __init__(self, reactor: Reactor) -> None:
        self.longest = 0.0
        self.rings = 0
        self._reactor = reactor
        self._rang: float | None = None
        reactor.call_at(0.0, self._ring)

    def _ring(self) -> None:
        self.rings += 1
        now = time.thread_time()
        if self._rang is not None:
            self.longest = max(self.longest, now - self._rang)
        self._rang = now
        self._reactor.call_at(self._reactor.now() + 0.001, self._ring)


def test_a_flood_of_messages_leaves_the_others_their_turn(served: ServedDevice) -> None:
    with served.client() as client:
        build(client, "R", "S SERVER_0_0 QI=1 ID=localhost:0\nN E_CTU PV=65535\nSTART.COLD -> S.INIT\nS.IND -> N.CU")
        client.start("R")
        wait_for(client, "R", "S.QO", lambda value: value == "TRUE")
        address = served.device.addresses()["S"]
        assert isinstance(address, Address)
        late = Lateness(served.reactor)
        with socket.create_connection(address) as peer:
            peer.sendall(bytes((NULL,)) * 9000)
            wait_for(client, "R", "N.CV", lambda value: value == "9000")
    assert late.rings > 2  # in one go there would be two


@pytest.mark.parametrize("period", ["T#0s", "T#1ns", "T#1us"])
def test_a_cycle_without_time_leaves_the_device_alive(good: ServedDevice, period: str) -> None:
    with good.client() as client:
        build(client, "R", f"C E_CYCLE DT={period}\nN E_CTU PV=65535\nSTART.COLD -> C.START\nC.EO -> N.CU")
        client.start("R")
        wait_for(client, "R", "N.CV", lambda value: int(value) > 20)
        client.stop("R")


def test_an_unforeseen_error_ends_its_resource_or_is_an_answer(
    good: ServedDevice, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> NoReturn:
        raise RecursionError("too deep")

    with good.client() as client:
        build(client, "BAD", "F F_SIN IN=LREAL#1\nSTART.COLD -> F.REQ")
        monkeypatch.setitem(FAST, "_sin", fail)
        compiled.cache_clear()
        client.start("BAD")
        until(lambda: "resource BAD ended: F.REQ: RecursionError: too deep" in caplog.text, "the resource has ended")
        monkeypatch.setattr(ManagedResource, "read", fail)
        assert client.request("GOOD", "READ", ManagedConnection("D.X", "*")).reason == "INVALID_OPERATION"
    compiled.cache_clear()
    assert "RecursionError: too deep" in caplog.records[-1].getMessage()
