"""SERVER, CLIENT, PUBLISH and SUBSCRIBE in process: INIT, QI, QO, STATUS and the values."""

from __future__ import annotations

from typing import Any

import pytest

from dtwin.errors import CommunicationError, FunctionBlockError
from iec61499.library import Library
from iec61499.runtime.communication import CommunicationPort, LocalTransport
from iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import Types, chart, network

WORK = chart(
    "WORK",
    "REQ(A B C) -> CNF(SUM TEXT)",
    "A: LREAL; B: BOOL; C: STRING -> SUM: LREAL; TEXT: STRING",
    {"START": [], "RUN": [("SUM := A + SEL(B, 0.0, 1.0); TEXT := CONCAT('got ', C);", "CNF")]},
    [("START", "REQ", "RUN"), ("RUN", "1", "START")],
)
WIRES = "START.COLD -> S.INIT; S.IND -> W.REQ; W.CNF -> S.RSP"
VALUES = "S.RD_1 -> W.A; S.RD_2 -> W.B; S.RD_3 -> W.C; W.SUM -> S.SD_1; W.TEXT -> S.SD_2"
GIVEN = {"S.QI": "TRUE", "S.ID": "'localhost:61500'"}


def served(wires: str = WIRES, data: str = VALUES, parameters: dict[str, str] = GIVEN) -> Resource:
    net = network("START: E_RESTART; S: SERVER_2_3; W: WORK; SPLIT: E_SPLIT; N: E_CTU", wires, data, parameters)
    return Resource(net, Types(WORK))


def test_exchange() -> None:
    resource = served()
    server = resource.server("S")
    assert [str(kind) for kind in server.receives] == ["LREAL", "BOOL", "STRING"]
    assert [str(kind) for kind in server.sends] == ["LREAL", "STRING"]
    resource.start()
    assert server.exchange((1.5, True, "red")) == (2.5, "got red")
    assert server.exchange([2.5, False, ""]) == (2.5, "got ")
    assert (resource.read("S.QO"), resource.read("S.STATUS")) == (True, "OK")


def test_exchange_needs_an_open_block_and_the_right_number_of_values() -> None:
    resource = served()
    server = resource.server("S")
    with pytest.raises(CommunicationError, match="S is not initialised: expected INIT with QI = TRUE"):
        server.exchange((1.0, True, ""))
    resource.start()
    with pytest.raises(CommunicationError, match="S got 2 values, expected 3"):
        server.exchange((1.0, True))
    assert server.exchange((1.0, True, "")) == (2.0, "got ")


def test_exchange_needs_one_answer() -> None:
    silent = served("START.COLD -> S.INIT")
    server = silent.server("S")
    silent.start()
    with pytest.raises(CommunicationError, match="S answered 0 times to one request: expected one RSP"):
        server.exchange((1.0, True, ""))
    twice = served("START.COLD -> S.INIT; S.IND -> SPLIT.EI; SPLIT.EO1 -> S.RSP; SPLIT.EO2 -> W.REQ; W.CNF -> S.RSP")
    server = twice.server("S")
    twice.start()
    with pytest.raises(CommunicationError, match="answered 2 times"):
        server.exchange((1.0, True, ""))


def test_an_array_that_arrives_shorter_keeps_its_other_elements() -> None:
    taker = chart(
        "TAKER",
        "REQ(A) -> CNF(B)",
        "A: INT[3] -> B: INT[3]",
        {"START": [], "RUN": [("B := A;", "CNF")]},
        [("START", "REQ", "RUN"), ("RUN", "1", "START")],
    )
    wires = "START.COLD -> S.INIT; S.IND -> T.REQ; T.CNF -> S.RSP"
    net = network("START: E_RESTART; S: SERVER_1_1; T: TAKER", wires, "S.RD_1 -> T.A; T.B -> S.SD_1", GIVEN)
    resource = Resource(net, Types(taker))
    server = resource.server("S")
    resource.start()
    assert server.exchange(([1, 2, 3],)) == ([1, 2, 3],)
    assert server.exchange(([7],)) == ([7, 2, 3],)
    assert server.exchange(([],)) == ([7, 2, 3],)


def test_requests_are_inhibited_without_qi() -> None:
    wires = "START.COLD -> C.INIT; START.WARM -> C.REQ; C.CNF -> N.CU"
    given = {"C.QI": "TRUE", "C.ID": "'x'"}
    resource = Resource(network("START: E_RESTART; C: CLIENT_0; N: E_CTU", wires, "", given), Library())
    resource.start()
    resource.write("C.QI", False)
    resource.stop()
    resource.start()
    assert (resource.read("C.QO"), resource.read("C.STATUS"), resource.read("N.CV")) == (False, "INHIBITED", 1)


def test_attaching_later_and_only_to_servers() -> None:
    resource = served()
    resource.start()
    assert resource.server("S").exchange((0.0, True, "")) == (1.0, "got ")
    published = Resource(network("P: PUBLISH_1"), Library())
    with pytest.raises(FunctionBlockError, match="P is a PUBLISH: expected a SERVER"):
        published.server("P")


def test_initialisation_and_its_end() -> None:
    wires = "START.COLD -> P.INIT; START.WARM -> P.INIT; P.INITO -> N.CU"
    resource = Resource(
        network("START: E_RESTART; P: PUBLISH_1; N: E_CTU", wires, "", {"P.QI": "TRUE", "P.ID": "'x'"}), Library()
    )
    resource.start()
    assert (resource.read("P.QO"), resource.read("P.STATUS"), resource.read("N.CV")) == (True, "OK", 1)
    assert resource.port("P").id == "fbdk[].ip[x]"
    resource.write("P.QI", False)
    resource.stop()
    resource.start()
    assert (resource.read("P.QO"), resource.read("P.STATUS"), resource.read("N.CV")) == (False, "TERMINATED", 2)
    assert not resource.port("P").is_open


def test_an_empty_id_is_invalid() -> None:
    resource = Resource(
        network("START: E_RESTART; P: PUBLISH_1", "START.COLD -> P.INIT", "", {"P.QI": "TRUE"}), Library()
    )
    resource.start()
    assert (resource.read("P.QO"), resource.read("P.STATUS")) == (False, "INVALID_ID")


def test_sending_before_the_initialisation() -> None:
    wires = "START.COLD -> P.REQ; P.CNF -> N.CU"
    resource = Resource(network("START: E_RESTART; P: PUBLISH_1; N: E_CTU", wires, "", {"P.QI": "TRUE"}), Library())
    resource.start()
    assert (resource.read("P.QO"), resource.read("P.STATUS"), resource.read("N.CV")) == (False, "NO_SOCKET", 1)


def test_client_and_server_of_one_id() -> None:
    wires = "START.COLD -> S.INIT; START.COLD -> C.INIT; C.INITO -> C.REQ; S.IND -> ADD.REQ; ADD.CNF -> S.RSP"
    blocks = "START: E_RESTART; S: SERVER_1_1; C: CLIENT_1_1; ADD: F_ADD; OUT: F_INT_TO_LREAL; IN: F_LREAL_TO_INT"
    data = "S.RD_1 -> ADD.IN1; ADD.OUT -> S.SD_1; C.RD_1 -> OUT.IN; IN.OUT -> C.SD_1; IN.OUT -> ADD.IN2"
    given = {"S.QI": "TRUE", "S.ID": "'localhost:1'", "C.QI": "TRUE", "C.ID": "'fbdk[].ip[localhost:1]'"}
    wires += "; C.CNF -> N.CU"
    blocks += "; N: E_CTU"
    resource = Resource(network(blocks, wires, data, given), Library())
    resource.write("IN.OUT", 21)
    resource.start()
    assert resource.read("C.RD_1") == 42
    assert resource.read("N.CV") == 1


def test_a_client_without_server() -> None:
    wires = "START.COLD -> C.INIT; C.INITO -> C.REQ; C.CNF -> N.CU"
    given = {"C.QI": "TRUE", "C.ID": "'localhost:1'"}
    resource = Resource(network("START: E_RESTART; C: CLIENT_0; N: E_CTU", wires, "", given), Library())
    resource.start()
    assert (resource.read("C.QO"), resource.read("C.STATUS"), resource.read("N.CV")) == (False, "SEND_FAILED", 1)


def test_one_server_an_id() -> None:
    given = {f"{name}.{port}": v for name in "AB" for port, v in (("QI", "TRUE"), ("ID", "'x'"))}
    wires = "START.COLD -> A.INIT; A.INITO -> B.INIT"
    resource = Resource(network("START: E_RESTART; A: SERVER_0; B: SERVER_0", wires, "", given), Library())
    resource.start()
    assert [resource.read(f"{name}.STATUS") for name in "AB"] == ["OK", "INVALID_ID"]


@pytest.mark.parametrize(("publisher", "subscriber"), [("PUBLISH_2", "SUBSCRIBE_2"), ("PUBL_2", "SUBL_2")])
def test_publishers_reach_subscribers_of_other_resources(publisher: str, subscriber: str) -> None:
    shared = LocalTransport()
    give = {"P.QI": "TRUE", "P.ID": "'x'"}
    take = {"S.QI": "TRUE", "S.ID": "'x'"}
    sender = Resource(
        network(
            "START: E_RESTART; P: " + publisher,
            "START.COLD -> P.INIT; START.WARM -> P.REQ",
            "",
            give | {"P.SD_1": "LREAL#1.5", "P.SD_2": "'red'"},
        ),
        Library(),
        shared,
    )
    receivers = [
        Resource(
            network(
                f"START: E_RESTART; S: {subscriber}; A: F_ABS; T: F_LEN; N: E_CTU",
                "START.COLD -> S.INIT; S.IND -> N.CU",
                "S.RD_1 -> A.IN; S.RD_2 -> T.IN",
                take,
            ),
            Library(),
            shared,
        )
        for _ in range(2)
    ]
    for resource in (*receivers, sender):
        resource.start()
    sender.stop()
    sender.start()
    assert (sender.read("P.STATUS"), sender.read("P.QO")) == ("OK", True)
    for resource in receivers:
        assert not resource.is_idle
        resource.run_until_idle()
        assert (resource.read("S.RD_1"), resource.read("S.RD_2"), resource.read("N.CV")) == (1.5, "red", 1)
    # a reset takes a block out
    receivers[0].reset()
    assert not receivers[0].port("S").is_open
    assert receivers[1].port("S").is_open


class SlowTransport:
    """A transport whose channels become usable when told, and fail when told."""

    is_ready = False
    confirms = False

    def __init__(self) -> None:
        self.sent: list[tuple[Any, ...]] = []
        self.ports: list[CommunicationPort] = []
        self.closed = 0
        self.broken = False

    def open(self, port: CommunicationPort) -> SlowTransport:
        self.ports.append(port)
        return self

    def send(self, values: tuple[Any, ...]) -> None:
        if self.broken:
            raise CommunicationError("broken")
        self.sent.append(values)

    def close(self) -> None:
        self.closed += 1


def test_a_transport_that_takes_its_time() -> None:
    transport = SlowTransport()
    wires = "START.COLD -> C.INIT; START.WARM -> C.REQ; C.INITO -> INITO.CU; C.CNF -> CNF.CU"
    given = {"C.QI": "TRUE", "C.ID": "'x'", "C.SD_1": "INT#7"}
    resource = Resource(
        network("START: E_RESTART; C: CLIENT_1_1; INITO: E_CTU; CNF: E_CTU", wires, "C.RD_1 -> CNF.PV", given),
        Library(),
        transport,
    )

    def request() -> tuple[Any, ...]:
        resource.stop()
        resource.start()
        return tuple(resource.read(name) for name in ("INITO.CV", "CNF.CV", "C.QO", "C.STATUS"))

    resource.start()
    assert request() == (0, 1, False, "NO_SOCKET")
    (port,) = transport.ports
    port.confirm_open()
    resource.run_until_idle()
    assert request() == (1, 1, True, "OK")
    assert transport.sent == [(7,)]
    port.deliver((9,))
    resource.run_until_idle()
    assert (resource.read("CNF.CV"), resource.read("C.RD_1")) == (2, 9)
    transport.broken = True
    assert request() == (1, 3, False, "SEND_FAILED")
    port.terminate()
    resource.run_until_idle()
    assert (resource.read("CNF.CV"), resource.read("C.STATUS"), transport.closed) == (4, "TERMINATED", 1)
    # what comes after the end changes nothing
    port.confirm_open()
    assert not port.is_open
    with pytest.raises(CommunicationError, match="C is not initialised"):
        port.deliver((1,))


def test_a_channel_that_cannot_be_opened() -> None:
    transport = SlowTransport()
    given = {"C.QI": "TRUE", "C.ID": "'x'"}
    resource = Resource(
        network("START: E_RESTART; C: CLIENT_0", "START.COLD -> C.INIT", "", given), Library(), transport
    )
    resource.start()
    transport.ports[0].refuse_open()
    assert (resource.read("C.QO"), resource.read("C.STATUS"), transport.closed) == (False, "INVALID_ID", 0)
    resource.run_until_idle()
    # its peer is there at last
    transport.ports[0].confirm_open()
    assert (resource.read("C.QO"), resource.read("C.STATUS")) == (True, "OK")
    resource.stop()
    resource.reset()
    resource.start()
    assert len(transport.ports) == 2


def test_texts_of_services_are_wide_where_they_are_connected_to_wide_ones() -> None:
    blocks = "ID: WSTRING2WSTRING; SEND: PUBLISH_1; SAID: WSTRING2WSTRING; X: INT2INT; GET: SUBSCRIBE_1; Y: INT2INT"
    data = "ID.OUT -> SEND.ID; SEND.STATUS -> SAID.IN; X.OUT -> SEND.SD_1; GET.RD_1 -> Y.IN"
    drawn = network(blocks, "ID.CNF -> SEND.INIT; SEND.INITO -> SAID.REQ; X.CNF -> SEND.REQ; GET.IND -> Y.REQ", data)
    resource = Resource(drawn, Types())
    for name, value in (("GET.ID", "loc[a]"), ("GET.QI", True), ("SEND.QI", True), ("ID.IN", "loc[a]"), ("X.IN", 7)):
        resource.write(name, value)
    for event in ("GET.INIT", "ID.REQ", "X.REQ"):
        resource.trigger(event)
        resource.run_until_idle()
    assert (resource.read("SAID.OUT"), resource.read("Y.OUT")) == ("OK", 7)
    assert str(resource.variable_type("SEND.STATUS")) == "WSTRING"
    assert str(resource.variable_type("GET.STATUS")) == "STRING"
