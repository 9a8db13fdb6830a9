"""The device's own OPC UA server: blocks whose IDs name no endpoint."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from typing import TYPE_CHECKING

import pytest

from iec61499.management.client import ManagementClient
from iec61499.net.settings import Connections, OwnServer
from tests.iec61499.net.opcua.conftest import Values, endpoint, run, serving, wait
from tests.support.iec61499.served_device import PATIENCE, ServedDevice, build

if TYPE_CHECKING:
    from asyncua import Client, ua
else:
    asyncua = pytest.importorskip("asyncua", reason="the extra opcua is not installed")
    Client, ua = asyncua.Client, asyncua.ua

PLANT = """
IN SUBSCRIBE_2 QI=1 ID="opc_ua[READ;/Objects/Plant/Speed;/Objects/Plant/2:Name,1:s=name]"
SPEED LREAL2LREAL
NAME STRING2STRING
OUT PUBLISH_2 QI=1 ID="opc_ua[WRITE;/Objects/Plant/Echo,1:i=5000;/Objects/Plant/Called]"
SUM F_ADD
METHOD SERVER_1_2 QI=1 ID="opc_ua[CREATE_METHOD;/Objects/Plant/Sum]"
A INT2INT
B INT2INT
C INT2INT
START.COLD -> IN.INIT
IN.INITO -> OUT.INIT
OUT.INITO -> METHOD.INIT
IN.IND -> SPEED.REQ
SPEED.CNF -> NAME.REQ
NAME.CNF -> OUT.REQ
IN.RD_1 -> SPEED.IN
IN.RD_2 -> NAME.IN
SPEED.OUT -> OUT.SD_1
NAME.OUT -> OUT.SD_2
METHOD.IND -> A.REQ
A.CNF -> B.REQ
B.CNF -> SUM.REQ
SUM.CNF -> C.REQ
C.CNF -> METHOD.RSP
METHOD.RD_1 -> A.IN
METHOD.RD_2 -> B.IN
A.OUT -> SUM.IN1
B.OUT -> SUM.IN2
SUM.OUT -> C.IN
C.OUT -> METHOD.SD_1
"""


def path(*names: str) -> list[str]:
    return ["0:Objects", *names]


def test_clients_write_what_blocks_read_and_call_what_they_answer(
    device: ServedDevice, management: ManagementClient
) -> None:
    build(management, "R", PLANT)
    management.start("R")
    wait(management, "METHOD.QO", "TRUE")

    async def scenario() -> None:
        async with Client(endpoint(device)) as client:
            root = client.nodes.root
            speed = await root.get_child(path("1:Plant", "1:Speed"))
            name = client.get_node("ns=1;s=name")
            assert (await name.read_browse_name()).to_string() == "2:Name"
            echo = client.get_node("ns=1;i=5000")
            assert await speed.read_data_type() == ua.NodeId(ua.ObjectIds.Double)
            values = Values()
            subscription = await client.create_subscription(10, values)
            called = await root.get_child(path("1:Plant", "1:Called"))
            await subscription.subscribe_data_change([echo, called])
            await speed.write_value(2.5)
            await values.wait(2.5)
            await name.write_value("Öl")
            await values.wait("Öl")
            with pytest.raises(ua.UaStatusCodeError):
                await echo.write_value(1.0)
            plant = await root.get_child(path("1:Plant"))
            whole = [ua.Variant(each, ua.VariantType.Int16) for each in (40, 2)]
            assert await plant.call_method("1:Sum", *whole) == 42
            with pytest.raises(ua.UaStatusCodeError):
                await plant.call_method("1:Sum", whole[0])
            with pytest.raises(ua.UaStatusCodeError):
                await plant.call_method("1:Sum", 40.0, 2.0)
            # a client that calls itself admin may do no more than the others
            async with Client(endpoint(device).replace("//", "//admin@")) as other:
                with pytest.raises(ua.UaStatusCodeError):
                    await other.get_node("ns=1;i=5000").write_value(1.0)

    run(scenario)
    assert management.read("R", "IN.RD_2") == "Öl"
    management.kill("R")

    async def gone() -> None:
        async with Client(endpoint(device)) as client:
            while await client.nodes.objects.get_child("1:Plant"):
                await asyncio.sleep(0)

    with pytest.raises(ua.UaStatusCodeError):
        run(gone)


@pytest.mark.parametrize(
    "steps",
    [
        'X SUBSCRIBE_1 QI=1 ID="opc_ua[READ;/Objects/1:V;/Objects/1:W]"\nY INT2INT\nX.RD_1 -> Y.IN',
        'X SUBSCRIBE_1 QI=1 ID="opc_ua[READ;/Objects/0:Server]"\nY INT2INT\nX.RD_1 -> Y.IN',
        'X SUBSCRIBE_1 QI=1 ID="opc_ua[READ;,1:i=77777]"\nY INT2INT\nX.RD_1 -> Y.IN',
        'X SUBSCRIBE_1 QI=1 ID="opc_ua[READ;/Objects/1:V]"\nY TOD2TOD\nX.RD_1 -> Y.IN',
        'X PUBLISH_0 QI=1 ID="opc_ua[CREATE_OBJECT;/Objects/1:O]"',
    ],
)
def test_what_cannot_be_is_terminated_as_on_forte(
    device: ServedDevice, management: ManagementClient, steps: str
) -> None:
    build(management, "R", steps + "\nSTART.COLD -> X.INIT")
    management.start("R")
    wait(management, "X.STATUS", "TERMINATED")
    assert management.read("R", "X.QO") == "FALSE"


def test_nodes_of_other_types_are_made_and_deleted(device: ServedDevice, management: ManagementClient) -> None:
    steps = """
    OBJECT PUBLISH_0 QI=1 ID="opc_ua[CREATE_OBJECT;,0:i=58;/Objects/Made/1:Object]"
    VARIABLE PUBLISH_0 QI=1 ID="opc_ua[CREATE_VARIABLE;KIND;,0:i=11;/Objects/Made/1:Number]"
    AGAIN PUBLISH_0 QI=1 ID="opc_ua[CREATE_OBJECT;,0:i=58;/Objects/Made/1:Object]"
    DELETE PUBLISH_0 QI=1 ID="opc_ua[DELETE_OBJECT;/Objects/Made/1:Object]"
    START.COLD -> OBJECT.INIT
    OBJECT.INITO -> VARIABLE.INIT
    VARIABLE.INITO -> AGAIN.INIT
    AGAIN.INITO -> DELETE.INIT
    DELETE.INITO -> OBJECT.REQ
    OBJECT.CNF -> VARIABLE.REQ
    VARIABLE.CNF -> AGAIN.REQ
    """
    kind = "/Types/0:VariableTypes/0:BaseVariableType/0:PropertyType"
    build(management, "R", steps.replace("KIND", kind))
    management.start("R")
    wait(management, "AGAIN.STATUS", "DATA_TYPE_ERROR")
    assert [management.read("R", f"{name}.STATUS") for name in ("OBJECT", "VARIABLE")] == ["OK", "OK"]

    async def scenario() -> None:
        async with Client(endpoint(device)) as client:
            made = await client.nodes.objects.get_child("1:Made")
            assert [node.to_string() for node in map_names(await made.get_children_descriptions())] == [
                "1:Number",
                "1:Object",
            ]

    def map_names(found: list[ua.ReferenceDescription]) -> list[ua.QualifiedName]:
        return sorted((each.BrowseName for each in found), key=lambda name: name.Name)

    run(scenario)
    management.trigger("R", "DELETE.REQ")
    management.trigger("R", "DELETE.REQ")
    wait(management, "DELETE.STATUS", "DATA_TYPE_ERROR")


def test_a_port_that_is_taken_is_told(caplog: pytest.LogCaptureFixture) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        where = f"127.0.0.1:{taken.getsockname()[1]}"
        with serving(Connections(OwnServer(where))) as device, device.client() as management:
            build(management, "R", 'X SUBSCRIBE_1 QI=1 ID="opc_ua[READ;/Objects/1:V]"\nY INT2INT')
            management.connect("R", "X.RD_1", "Y.IN")
            management.connect("R", "START.COLD", "X.INIT")
            management.start("R")
            wait(management, "X.STATUS", "TERMINATED")
    assert f"X: cannot listen for OPC UA at {where}: " in caplog.text


def test_garbage_costs_a_connection_and_no_more(device: ServedDevice, management: ManagementClient) -> None:
    build(management, "R", PLANT)
    management.start("R")
    port = int(endpoint(device).rpartition(":")[2])
    for data in (b"GET / HTTP/1.0\r\n\r\n", b"HELF\xff\xff\xff\xff" + b"x" * 4096, bytes(range(256)) * 16):
        with socket.create_connection(("127.0.0.1", port), PATIENCE) as peer, contextlib.suppress(OSError):
            peer.sendall(data)

    async def scenario() -> None:
        async with Client(endpoint(device)) as client:
            plant = await client.nodes.objects.get_child("1:Plant")
            whole = [ua.Variant(each, ua.VariantType.Int16) for each in (40, 2)]
            assert await plant.call_method("1:Sum", *whole) == 42

    wait(management, "METHOD.QO", "TRUE")
    run(scenario)


PAIR = """
IN SUBSCRIBE_2 QI=1 ID="opc_ua[READ;/Objects/Pair/A;/Objects/Pair/B]"
A DINT2DINT
B DINT2DINT
SAME F_EQ
SWITCH E_SWITCH
TORN E_CTU PV=60000
OUT PUBLISH_2 QI=1 ID="opc_ua[WRITE;/Objects/Pair/A;/Objects/Pair/B]"
NEXT F_ADD IN2=DINT#1
LAST DINT2DINT
START.COLD -> IN.INIT
IN.INITO -> OUT.INIT
IN.IND -> A.REQ
A.CNF -> B.REQ
B.CNF -> SAME.REQ
SAME.CNF -> SWITCH.EI
SWITCH.EO0 -> TORN.CU
IN.RD_1 -> A.IN
IN.RD_2 -> B.IN
A.OUT -> SAME.IN1
B.OUT -> SAME.IN2
SAME.OUT -> SWITCH.G
NEXT.CNF -> LAST.REQ
LAST.CNF -> OUT.REQ
LAST.OUT -> NEXT.IN1
NEXT.OUT -> LAST.IN
LAST.OUT -> OUT.SD_1
LAST.OUT -> OUT.SD_2
"""


def test_values_that_are_written_together_arrive_together(device: ServedDevice, management: ManagementClient) -> None:
    build(management, "R", PAIR)
    management.start("R")
    wait(management, "OUT.QO", "TRUE")

    async def scenario() -> None:
        async with Client(endpoint(device)) as client:
            pair = await client.nodes.objects.get_child("1:Pair")
            nodes = [await pair.get_child(f"1:{name}") for name in "AB"]
            for number in range(1, 41):
                await client.write_values(nodes, [ua.Variant(number, ua.VariantType.Int32)] * 2)

    run(scenario)
    wait(management, "B.OUT", "40")
    for _ in range(41):
        management.trigger("R", "NEXT.REQ")
    wait(management, "B.OUT", "41")
    assert management.read("R", "TORN.CV") == "0"


def test_nodes_of_one_name_stand_side_by_side(device: ServedDevice, management: ManagementClient) -> None:
    steps = """
    FIRST SUBSCRIBE_1 QI=1 ID="opc_ua[READ;/Objects/Twins/Twin,1:i=71/]"
    A INT2INT
    SECOND SUBSCRIBE_1 QI=1 ID="opc_ua[READ;/Objects/Twins/Twin,1:i=72]"
    B INT2INT
    THIRD SUBSCRIBE_1 QI=1 ID="opc_ua[READ;/Objects/Twins/Twin,1:i=72]"
    C INT2INT
    START.COLD -> FIRST.INIT
    FIRST.INITO -> SECOND.INIT
    SECOND.INITO -> THIRD.INIT
    SECOND.IND -> B.REQ
    FIRST.RD_1 -> A.IN
    SECOND.RD_1 -> B.IN
    THIRD.RD_1 -> C.IN
    """
    build(management, "R", steps)
    management.start("R")
    wait(management, "THIRD.STATUS", "TERMINATED")
    assert management.read("R", "FIRST.QO") == management.read("R", "SECOND.QO") == "TRUE"

    async def scenario() -> None:
        async with Client(endpoint(device)) as client:
            await client.get_node("ns=1;i=72").write_value(5, ua.VariantType.Int16)

    run(scenario)
    wait(management, "B.OUT", "5")
