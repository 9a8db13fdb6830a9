"""A device whose resources are machine code: it serves and is managed like the other one, but stays as it is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import (
    Change,
    ManagedBlock,
    ManagedConnection,
    ManagementError,
    RequestAction,
    Subject,
)
from tests.support.iec61499.c_harness import needs_compiler
from tests.support.iec61499.served_device import ANY_PORT, ServedDevice, build, wait_for
from tests.support.waiting import until

pytestmark = needs_compiler
ASKED = """
CYCLE E_CYCLE DT=T#2ms
COUNT E_CTU
N UINT2UINT
ASK CLIENT_1_1 QI=1 ID="{}"
BACK UINT2UINT
LAST E_CTU
START.COLD -> ASK.INIT
ASK.INITO -> CYCLE.START
CYCLE.EO -> COUNT.CU
COUNT.CUO -> N.REQ
N.CNF -> ASK.REQ
ASK.CNF -> BACK.REQ
BACK.CNF -> LAST.CU
COUNT.CV -> N.IN
N.OUT -> ASK.SD_1
ASK.RD_1 -> BACK.IN
"""
ANSWERING = """
SERVE SERVER_1_1 QI=1 ID="localhost:0"
TWICE F_ADD
IN UINT2UINT
OUT UINT2UINT
START.COLD -> SERVE.INIT
SERVE.IND -> IN.REQ
IN.CNF -> TWICE.REQ
TWICE.CNF -> OUT.REQ
OUT.CNF -> SERVE.RSP
SERVE.RD_1 -> IN.IN
IN.OUT -> TWICE.IN1
IN.OUT -> TWICE.IN2
TWICE.OUT -> OUT.IN
OUT.OUT -> SERVE.SD_1
"""


@contextmanager
def device(native: bool) -> Iterator[ServedDevice]:
    made = ServedDevice(Library([]), ANY_PORT, native=native)
    made.start()
    try:
        yield made
    finally:
        made.stop()


@pytest.fixture
def native() -> Iterator[ServedDevice]:
    with device(native=True) as made:
        yield made


def refused(client: ManagementClient, action: RequestAction, subject: Subject) -> bool:
    """Whether a request to the resource A is refused because it cannot be changed."""
    return client.request("A", action, subject).reason == "INVALID_OPERATION"


@pytest.mark.parametrize(("asks", "answers"), [(True, True), (True, False), (False, True)])
def test_timed_and_communication_blocks_run(asks: bool, answers: bool) -> None:
    with device(asks) as asking, device(answers) as answering, answering.client() as there, asking.client() as here:
        build(there, "B", ANSWERING)
        there.start("B")
        where = answering.device.addresses()["SERVE"]
        build(here, "A", ASKED.format(where))
        here.start("A")
        wait_for(here, "A", "LAST.CV", lambda value: int(value) >= 5)
        here.request("", "STOP", ManagedBlock("A", ""))
        answered = int(here.read("A", "LAST.CV"))
        assert here.read("A", "BACK.OUT") == str(2 * answered)
        assert int(here.read("A", "COUNT.CV")) >= answered


def test_what_runs_is_not_changed_but_read_written_and_triggered(native: ServedDevice) -> None:
    with native.client() as client:
        build(client, "A", "COUNT E_CTU PV=7\nNAME STRING2STRING")
        client.start("A")
        client.trigger("A", "COUNT.CU")
        wait_for(client, "A", "COUNT.CV", lambda value: value == "1")
        client.write("A", "NAME.IN", "'text'")
        assert client.read("A", "NAME.IN") == "text"
        client.watch("A", "COUNT.CV")
        assert client.watched("A") == {"COUNT.CV": "1"}
        with pytest.raises(ManagementError, match="INVALID_OPERATION"):
            client.watch("A", "COUNT.CU")
        assert refused(client, "CREATE", ManagedBlock("OTHER", "E_CTU"))
        assert refused(client, "CREATE", ManagedConnection("COUNT.CUO", "COUNT.R"))
        assert refused(client, "STOP", ManagedBlock("COUNT", ""))
        assert refused(client, "CREATE", Change())
        assert refused(client, "WRITE", ManagedConnection("3", "COUNT.PV", "true"))
        assert client.read("A", "COUNT.PV") == "7"
        for action in ("STOP", "START"):
            client.demand("A", action)
        client.trigger("A", "COUNT.CU")
        wait_for(client, "A", "COUNT.CV", lambda value: value == "2")


def test_an_error_ends_the_resource_and_is_told(native: ServedDevice, caplog: pytest.LogCaptureFixture) -> None:
    with native.client() as client:
        build(client, "A", "A E_MERGE\nB E_MERGE\nA.EO -> B.EI1\nB.EO -> A.EI1")
        client.start("A")
        client.trigger("A", "A.EI2")
        until(lambda: "resource A ended" in caplog.text, "the log names the resource")
        assert "endless loop of events" in caplog.text
        assert client.request("A", "START").reason == "INVALID_STATE"
