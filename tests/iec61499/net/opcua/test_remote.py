"""Blocks whose IDs name the endpoint of another server, which starts later, and once more."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from iec61499.management.client import ManagementClient
from tests.iec61499.net.opcua.conftest import LONG, run, wait
from tests.support.iec61499.served_device import ServedDevice, build, wait_for
from tests.support.ports import free_port

if TYPE_CHECKING:
    from asyncua import Server, ua
else:
    asyncua = pytest.importorskip("asyncua", reason="the extra opcua is not installed")
    Server, ua = asyncua.Server, asyncua.ua

NETWORK = """
READ CLIENT_0_1 QI=1 ID="opc_ua[READ;opc.tcp://127.0.0.1:PORT#;/Objects/1:Level]"
GOT LREAL2LREAL
WRITE CLIENT_1_0 QI=1 ID="opc_ua[WRITE;opc.tcp://127.0.0.1:PORT#;,1:s=valve]"
VALVE BOOL2BOOL
WRITTEN E_CTU PV=9
CALL CLIENT_2_1 QI=1 ID="opc_ua[CALL_METHOD;opc.tcp://127.0.0.1:PORT#;/1:Add]"
A INT2INT
B INT2INT
SUM INT2INT
SEEN SUBSCRIBE_1 QI=1 ID="opc_ua[SUBSCRIBE;opc.tcp://127.0.0.1:PORT#;/Objects/1:Level]"
LEVEL LREAL2LREAL
START.COLD -> READ.INIT
READ.INITO -> WRITE.INIT
WRITE.INITO -> CALL.INIT
CALL.INITO -> SEEN.INIT
READ.RD_1 -> GOT.IN
VALVE.OUT -> WRITE.SD_1
A.OUT -> CALL.SD_1
B.OUT -> CALL.SD_2
CALL.RD_1 -> SUM.IN
SEEN.RD_1 -> LEVEL.IN
VALVE.CNF -> WRITE.REQ
WRITE.CNF -> WRITTEN.CU
A.CNF -> B.REQ
B.CNF -> CALL.REQ
READ.CNF -> GOT.REQ
CALL.CNF -> SUM.REQ
SEEN.IND -> LEVEL.REQ
"""


def add(parent: ua.NodeId, first: ua.Variant, second: ua.Variant) -> list[ua.Variant]:
    return [ua.Variant(first.Value + second.Value, ua.VariantType.Int16)]


async def with_nodes(port: int) -> Server:
    server = Server()
    await server.init()
    server.set_endpoint(f"opc.tcp://127.0.0.1:{port}")
    objects = server.nodes.objects
    await objects.add_variable(ua.NodeId("level", 1), "1:Level", 1.5)
    valve = await objects.add_variable(ua.NodeId("valve", 1), "1:Valve", False)
    await valve.set_writable()
    await server.nodes.root.add_method(1, "Add", add, [ua.VariantType.Int16] * 2, [ua.VariantType.Int16])
    return server


def test_a_server_is_read_written_called_and_watched_as_soon_as_it_is_there(
    device: ServedDevice, management: ManagementClient, caplog: pytest.LogCaptureFixture
) -> None:
    port = free_port()
    build(management, "R", NETWORK.replace("PORT", str(port)))
    management.start("R")

    def asked(event: str, status: str) -> None:
        """A request that ends as wanted, asked again until the device has found the server."""

        def again(value: str) -> bool:
            if value != status:
                management.trigger("R", event)
            return value == status

        block = event.partition(".")[0]
        management.trigger("R", event)
        wait_for(management, "R", f"{block}.STATUS", again, LONG)

    wait(management, "SEEN.QO", "TRUE")
    asked("READ.REQ", "DATA_TYPE_ERROR")

    async def scenario() -> None:
        server = await with_nodes(port)
        await server.start()

        async def meanwhile(name: str, condition: Callable[[str], bool]) -> str:
            return await asyncio.to_thread(wait_for, management, "R", name, condition, LONG)

        await asyncio.to_thread(asked, "READ.REQ", "OK")
        assert await meanwhile("GOT.OUT", lambda value: value == "1.5")
        assert await meanwhile("LEVEL.OUT", lambda value: value == "1.5")
        management.write("R", "VALVE.IN", "TRUE")
        management.trigger("R", "VALVE.REQ")
        await meanwhile("WRITTEN.CV", lambda value: value == "1")
        assert await server.get_node("ns=1;s=valve").read_value() is True
        management.write("R", "A.IN", "40")
        management.write("R", "B.IN", "2")
        management.trigger("R", "A.REQ")
        await meanwhile("SUM.OUT", lambda value: value == "42")
        await server.stop()
        await asyncio.to_thread(asked, "READ.REQ", "DATA_TYPE_ERROR")
        await server.get_node("ns=1;s=level").write_value(7.25)
        await server.start()
        assert await meanwhile("LEVEL.OUT", lambda value: value == "7.25")
        await asyncio.to_thread(asked, "READ.REQ", "OK")
        await server.get_node("ns=1;s=level").write_attribute(
            ua.AttributeIds.Value, ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadSensorFailure))
        )
        await asyncio.to_thread(asked, "READ.REQ", "RECV_FAILED")
        await server.stop()

    run(scenario)
    assert "cannot connect: " in caplog.text
    assert "Traceback" not in caplog.text
