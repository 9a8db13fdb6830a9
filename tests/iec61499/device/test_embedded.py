"""The embedded runtime as a device: its blocks in real time, over TCP and UDP, and boot files."""

from __future__ import annotations

import time

import pytest

from dtwin.controller.ports import EMULATOR
from dtwin.errors import FunctionBlockError
from dtwin.parameters import ROOT
from iec61499.management.bootfile import parse_boot_file
from iec61499.management.protocol import ManagedBlock
from iec61499.mapping import resource_network
from iec61499.net.client import BlockingClient
from iec61499.runtime.resource import Resource
from tests.support.iec61499.served_device import (
    BOOT,
    DOUBLING,
    PATIENCE,
    ServedDevice,
    build,
    free_address,
    samples,
    wait_for,
)
from tests.support.waiting import until


def test_cycles_run_on_the_clock(served: ServedDevice) -> None:
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


def test_blocks_of_two_resources_meet_in_process_and_over_udp(served: ServedDevice) -> None:
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


def test_a_client_block_calls_a_server_block(served: ServedDevice) -> None:
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
def test_a_client_that_cannot_connect_says_so(served: ServedDevice, identifier: str) -> None:
    with served.client() as client:
        build(client, "R", f"C CLIENT_0 QI=1 ID={identifier}\nSTART.COLD -> C.INIT")
        client.start("R")
        assert wait_for(client, "R", "C.STATUS", bool) == "INVALID_ID"
        assert client.read("R", "C.QO") == "FALSE"


def test_a_client_connects_when_its_server_starts_later(served: ServedDevice) -> None:
    where = free_address()
    with served.client() as client:
        steps = f"C CLIENT_0 QI=1 ID={where}\nS SERVER_0 QI=1 ID={where}\nN E_CTU PV=9"
        build(client, "R", f"{steps}\nSTART.COLD -> C.INIT\nC.INITO -> N.CU")
        client.start("R")
        assert wait_for(client, "R", "C.STATUS", bool) == "INVALID_ID"
        client.trigger("R", "S.INIT")
        assert wait_for(client, "R", "C.STATUS", lambda value: value != "INVALID_ID") == "OK"
        assert client.read("R", "C.QO") == "TRUE"
        assert wait_for(client, "R", "N.CV", lambda value: value == "2") == "2"


def test_a_block_of_a_resource_that_idles_is_started(served: ServedDevice) -> None:
    with served.client() as client:
        build(client, "R", "A E_CTU")
        block = ManagedBlock("A", "")
        client.demand("R", "START", block)
        assert client.request("R", "START", block).reason == "INVALID_STATE"
        assert client.request("R", "DELETE", block).reason == "INVALID_STATE"
        client.demand("R", "STOP", block)
        client.start("R")
        client.demand("R", "STOP", block)
        client.delete_block("R", "A")


def test_an_endless_loop_ends_its_resource_only(served: ServedDevice, caplog: pytest.LogCaptureFixture) -> None:
    with served.client() as client:
        build(client, "GOOD", DOUBLING)
        client.start("GOOD")
        build(client, "BAD", "D DOUBLER\nSTART.COLD -> D.REQ\nD.CNF -> D.REQ")
        client.start("BAD")
        until(lambda: "resource BAD ended" in caplog.text, "the resource has ended")
        assert client.request("BAD", "STOP").reason == "INVALID_STATE"
        with served.connect("S") as peer:
            assert peer.exchange([1.0]) == (2.0,)
    messages = [record.getMessage() for record in caplog.records if record.levelname == "ERROR"]
    assert len(messages) == 1
    assert "resource BAD ended: " in messages[0]
    assert "endless loop of events: D.REQ" in messages[0]


def test_a_boot_file_is_carried_out(served: ServedDevice) -> None:
    served.device.load_commands(parse_boot_file(BOOT))
    with served.client() as client:
        assert client.read("R", "C.DT") == "T#1ms"


def test_a_refused_boot_command_names_its_line(served: ServedDevice) -> None:
    commands = parse_boot_file(BOOT.replace("T#1ms", "often"))
    with pytest.raises(FunctionBlockError, match=r"^app\.fboot:3: WRITE often to C\.DT refused: BAD_PARAMS"):
        served.device.load_commands(commands, "app.fboot")


def test_served_answers_are_those_of_the_resource_in_process(cell: ServedDevice) -> None:
    system = cell.library.load_system(ROOT / "fb" / "dtwin.sys")
    resource = Resource(resource_network(system), cell.library)
    server = resource.server("EMULATOR")
    resource.start()
    with BlockingClient(
        cell.device.addresses()["CELL.EMULATOR"], EMULATOR.receives, EMULATOR.sends, PATIENCE
    ) as peer:
        for sample in samples(2000):
            assert peer.exchange(sample) == server.exchange(sample)
