"""OPC UA between a real 4diac FORTE and a device of `fb run`: each of them serves, and asks the other."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from iec61499.management.client import ManagementClient
from tests.iec61499.net.opcua.conftest import endpoint, serving
from tests.support.forte import FORTE_OPCUA, NO_FORTE_OPCUA, forte
from tests.support.iec61499.served_device import build, wait_for
from tests.support.ports import free_port
from tests.support.waiting import connected

pytestmark = pytest.mark.skipif(not FORTE_OPCUA, reason=NO_FORTE_OPCUA)
pytest.importorskip("asyncua", reason="the extra opcua is not installed")
LONG = 60.0
ASKED = """
SPEED SUBSCRIBE_1 QI=1 ID="opc_ua[READ;/Objects/1:Plant/1:Speed]"
GOT LREAL2LREAL
STATE PUBLISH_2 QI=1 ID="opc_ua[WRITE;/Objects/1:Plant/1:State;/Objects/1:Plant/1:Run]"
LEVEL INT2INT
RUN BOOL2BOOL
ADD SERVER_1_2 QI=1 ID="opc_ua[CREATE_METHOD;/Objects/1:Plant/1:Add]"
A INT2INT
B INT2INT
SUM F_ADD
RESULT INT2INT
START.COLD -> SPEED.INIT
SPEED.INITO -> STATE.INIT
STATE.INITO -> ADD.INIT
SPEED.RD_1 -> GOT.IN
SPEED.IND -> GOT.REQ
LEVEL.OUT -> STATE.SD_1
RUN.OUT -> STATE.SD_2
LEVEL.CNF -> RUN.REQ
RUN.CNF -> STATE.REQ
ADD.RD_1 -> A.IN
ADD.RD_2 -> B.IN
A.OUT -> SUM.IN1
B.OUT -> SUM.IN2
SUM.OUT -> RESULT.IN
RESULT.OUT -> ADD.SD_1
ADD.IND -> A.REQ
A.CNF -> B.REQ
B.CNF -> SUM.REQ
SUM.CNF -> RESULT.REQ
RESULT.CNF -> ADD.RSP
"""
"""Variables that others write and read, and a method."""
ASKING = """
WRITE CLIENT_1_0 QI=1 ID="opc_ua[WRITE;ENDPOINT#;/Objects/1:Plant/1:Speed]"
SPEED LREAL2LREAL
WRITTEN E_CTU PV=9
READ CLIENT_0_2 QI=1 ID="opc_ua[READ;ENDPOINT#;/Objects/1:Plant/1:State;/Objects/1:Plant/1:Run]"
LEVEL INT2INT
RUN BOOL2BOOL
CALL CLIENT_2_1 QI=1 ID="opc_ua[CALL_METHOD;ENDPOINT#;/Objects/1:Plant/1:Add]"
A INT2INT
B INT2INT
SUM INT2INT
SEEN SUBSCRIBE_1 QI=1 ID="opc_ua[SUBSCRIBE;ENDPOINT#;/Objects/1:Plant/1:State]"
LAST INT2INT
START.COLD -> WRITE.INIT
WRITE.INITO -> READ.INIT
READ.INITO -> CALL.INIT
CALL.INITO -> SEEN.INIT
SPEED.OUT -> WRITE.SD_1
SPEED.CNF -> WRITE.REQ
WRITE.CNF -> WRITTEN.CU
READ.RD_1 -> LEVEL.IN
READ.RD_2 -> RUN.IN
READ.CNF -> LEVEL.REQ
LEVEL.CNF -> RUN.REQ
A.OUT -> CALL.SD_1
B.OUT -> CALL.SD_2
CALL.RD_1 -> SUM.IN
A.CNF -> B.REQ
B.CNF -> CALL.REQ
CALL.CNF -> SUM.REQ
SEEN.RD_1 -> LAST.IN
SEEN.IND -> LAST.REQ
"""
"""Writes, reads, calls and watches them."""


@contextlib.contextmanager
def devices(tmp_path: Path, forte_asks: bool) -> Iterator[tuple[ManagementClient, ManagementClient]]:
    """The device that is asked, its network running, and the one that asks."""
    port = free_port()
    with (
        serving() as device,
        device.client() as own,
        forte(tmp_path, "-op", str(port), binary=FORTE_OPCUA) as address,
        connected(lambda: ManagementClient(address)) as other,
    ):
        asked, asking = (own, other) if forte_asks else (other, own)
        build(asked, "R", ASKED)
        asked.start("R")
        where = endpoint(device) if forte_asks else f"opc.tcp://127.0.0.1:{port}"
        build(asking, "R", ASKING.replace("ENDPOINT", where))
        asking.start("R")
        yield asked, asking


@pytest.mark.parametrize("forte_asks", [False, True], ids=["here asks", "FORTE asks"])
def test_either_writes_reads_calls_and_watches_what_the_other_has(tmp_path: Path, forte_asks: bool) -> None:
    with devices(tmp_path, forte_asks) as (asked, asking):

        def comes(client: ManagementClient, name: str, wanted: str, event: str = "") -> None:
            """Waits for a value; while it is another one the event is triggered."""

            def met(value: str) -> bool:
                if value != wanted and event:
                    asking.trigger("R", event)
                return value == wanted

            wait_for(client, "R", name, met, LONG)

        asking.write("R", "SPEED.IN", "2.5")
        comes(asked, "GOT.OUT", "2.5", "SPEED.REQ")
        asked.write("R", "LEVEL.IN", "-7")
        asked.write("R", "RUN.IN", "TRUE")
        asked.trigger("R", "LEVEL.REQ")
        comes(asking, "LEVEL.OUT", "-7", "READ.REQ")
        comes(asking, "RUN.OUT", "TRUE")
        comes(asking, "LAST.OUT", "-7")
        asked.write("R", "LEVEL.IN", "1234")
        asked.trigger("R", "LEVEL.REQ")
        comes(asking, "LAST.OUT", "1234")
        asking.write("R", "A.IN", "40")
        asking.write("R", "B.IN", "2")
        comes(asking, "SUM.OUT", "42", "A.REQ")
