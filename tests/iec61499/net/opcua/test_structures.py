"""Structures as values of OPC UA: what their bytes are, and that peers who ask the server understand them."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iec61499.errors import CommunicationError
from iec61499.net.settings import Connections, OwnServer
from iec61499.types import ELEMENTARY, ArrayType, Member, StructType
from tests.iec61499.net.opcua.conftest import Values, endpoint, run, serving
from tests.support.iec61499.served_device import ServedDevice, build, wait_for
from tests.support.ports import free_port

if TYPE_CHECKING:
    from asyncua import Client, Server, ua
    from asyncua.common import structures104
else:
    asyncua = pytest.importorskip("asyncua", reason="the extra opcua is not installed")
    Client, Server, ua = asyncua.Client, asyncua.Server, asyncua.ua
    structures104 = pytest.importorskip("asyncua.common.structures104")

INT, REAL, STRING, BOOL = (ELEMENTARY[name] for name in ("INT", "REAL", "STRING", "BOOL"))
POINT = StructType(
    "POINT", (Member("X", REAL, 0.0), Member("NAME", STRING, ""), Member("AT", ArrayType(INT, 0, 2), [0, 0, 0]))
)
LINE = StructType(
    "LINE", (Member("FIRST", POINT, POINT.default), Member("OTHERS", ArrayType(POINT, 0, 1), [POINT.default] * 2))
)
POINTS = """<DataType Name="POINT"><StructuredType><VarDeclaration Name="X" Type="REAL"/>
<VarDeclaration Name="NAME" Type="STRING"/><VarDeclaration Name="AT" Type="INT" ArraySize="3"/>
</StructuredType></DataType>"""
LINES = """<DataType Name="LINE"><StructuredType><VarDeclaration Name="FIRST" Type="POINT"/>
<VarDeclaration Name="OTHERS" Type="POINT" ArraySize="2"/></StructuredType></DataType>"""
BLOCK = """<FBType Name="{name}"><InterfaceList>
<EventInputs><Event Name="REQ">{withs}</Event></EventInputs>
<EventOutputs><Event Name="CNF">{out}</Event></EventOutputs>
<InputVars>{inputs}</InputVars><OutputVars>{outputs}</OutputVars></InterfaceList>
<SimpleFB><Algorithm Name="REQ"><ST>{text}</ST></Algorithm></SimpleFB></FBType>"""
VARIABLE = '<VarDeclaration Name="{}" Type="{}"/>'
MAKE = BLOCK.format(
    name="MAKE",
    withs='<With Var="N"/>',
    out='<With Var="L"/>',
    inputs=VARIABLE.format("N", "INT"),
    outputs=VARIABLE.format("L", "LINE"),
    text="L.FIRST.X := 0.5; L.FIRST.NAME := 'first'; L.OTHERS[1].AT[2] := N; L.OTHERS[1].NAME := 'last';",
)
TAKE = BLOCK.format(
    name="TAKE",
    withs='<With Var="L"/>',
    out='<With Var="N"/><With Var="NAME"/>',
    inputs=VARIABLE.format("L", "LINE"),
    outputs=VARIABLE.format("N", "INT") + VARIABLE.format("NAME", "STRING"),
    text="N := L.OTHERS[1].AT[2]; NAME := L.FIRST.NAME;",
)
SERVING = """
IN SUBSCRIBE_1 QI=1 ID="opc_ua[READ;/Objects/Plant/Wanted]"
TAKEN TAKE
MADE MAKE
OUT PUBLISH_1 QI=1 ID="opc_ua[WRITE;/Objects/Plant/Line]"
START.COLD -> IN.INIT
IN.INITO -> OUT.INIT
IN.IND -> TAKEN.REQ
IN.RD_1 -> TAKEN.L
MADE.CNF -> OUT.REQ
MADE.L -> OUT.SD_1
TAKEN.CNF -> MADE.REQ
TAKEN.N -> MADE.N
"""
ASKING = """
MADE MAKE
TELL CLIENT_1_0 QI=1 ID="opc_ua[WRITE;opc.tcp://127.0.0.1:PORT#;/Objects/1:Plant/1:Wanted]"
SEEN SUBSCRIBE_1 QI=1 ID="opc_ua[SUBSCRIBE;opc.tcp://127.0.0.1:PORT#;/Objects/1:Plant/1:Line]"
TAKEN TAKE
START.COLD -> TELL.INIT
TELL.INITO -> SEEN.INIT
MADE.CNF -> TELL.REQ
MADE.L -> TELL.SD_1
SEEN.IND -> TAKEN.REQ
SEEN.RD_1 -> TAKEN.L
"""


@pytest.fixture(scope="module")
def types(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("types")
    for name, text in (("POINT.dtp", POINTS), ("LINE.dtp", LINES), ("MAKE.fbt", MAKE), ("TAKE.fbt", TAKE)):
        (folder / name).write_text(text)
    return folder


@pytest.fixture(scope="module")
def served_plant(types: Path) -> Iterator[ServedDevice]:
    with serving(Connections(OwnServer("127.0.0.1:0")), [types]) as device, device.client() as management:
        build(management, "R", SERVING)
        management.start("R")
        wait_for(management, "R", "OUT.QO", lambda value: value == "TRUE", 60.0)
        yield device


def bound(kind: Any) -> Any:
    """A converter as if a server had told its nodes."""
    from iec61499.net.opcua.structures import StructureConverter

    made = StructureConverter(kind)
    made.bind(ua.NodeId(1, 1), ua.NodeId(2, 1))
    return made


def test_the_bytes_are_those_of_the_standard() -> None:
    # part 6, 5.2.2: little-endian, a string and an array begin with their length
    wanted = bytes.fromhex("0000003f 02000000 4f6b 03000000 0100 0200 ffff".replace(" ", ""))
    encoded = bound(POINT).encode([0.5, "Ok", [1, 2, -1]])
    assert encoded.Value.Body == wanted
    assert encoded.VariantType == ua.VariantType.ExtensionObject


TEXTS = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=9)
POINT_VALUES = st.tuples(
    st.floats(width=32, allow_nan=False), TEXTS, st.lists(st.integers(-(2**15), 2**15 - 1), min_size=3, max_size=3)
).map(list)


@given(POINT_VALUES, st.lists(POINT_VALUES, min_size=2, max_size=2))
def test_a_value_comes_back_as_it_went(first: list[Any], others: list[Any]) -> None:
    for kind, value in ((LINE, [first, others]), (ArrayType(POINT, 0, 1), others)):
        found = bound(kind)
        variant = found.encode(value)
        assert found.decode(ua.Variant(variant.Value, variant.VariantType)) == value


@given(st.binary(max_size=60))
def test_foreign_bytes_are_a_value_or_told(body: bytes) -> None:
    found = bound(LINE)
    try:
        value = found.decode(ua.Variant(ua.ExtensionObject(ua.NodeId(2, 1), body), ua.VariantType.ExtensionObject))
    except CommunicationError:
        return
    assert found.encode(value).Value.Body == body


def test_what_is_another_structure_is_told() -> None:
    from iec61499.net.opcua.structures import StructureConverter

    found = bound(POINT)
    other = ua.ExtensionObject(ua.NodeId(9, 1), b"")
    with pytest.raises(CommunicationError, match="got a structure ns=1;i=9, expected POINT"):
        found.decode(ua.Variant(other, ua.VariantType.ExtensionObject))
    with pytest.raises(CommunicationError, match="got Int16, expected the structure POINT"):
        found.decode(ua.Variant(1, ua.VariantType.Int16))
    with pytest.raises(CommunicationError, match="has not told yet"):
        StructureConverter(POINT).encode(POINT.default)
    with pytest.raises(CommunicationError, match=r"P\.T: TOD has no value of OPC UA"):
        StructureConverter(StructType("P", (Member("T", ELEMENTARY["TOD"], 0),)))


def test_a_client_that_asks_the_server_for_its_types_reads_and_writes(served_plant: ServedDevice) -> None:
    async def scenario() -> None:
        async with Client(endpoint(served_plant)) as client:
            classes = await client.load_data_type_definitions()
            wanted, line = [
                await client.nodes.root.get_child(["0:Objects", "1:Plant", f"1:{name}"])
                for name in ("Wanted", "Line")
            ]
            value = classes["LINE"]()
            value.FIRST.NAME = "hello"
            value.OTHERS = [classes["POINT"](AT=[0, 0, 0]), classes["POINT"](AT=[0, 0, 41])]
            seen = Values()
            subscription = await client.create_subscription(10, seen)
            await subscription.subscribe_data_change(line)
            await wanted.write_value(value)
            while (await line.read_value()).OTHERS[1].AT[2:] != [41]:
                await seen.change()
            assert classes["POINT"](0.5, "first", [0, 0, 0]) == (await line.read_value()).FIRST

    run(scenario)
    with served_plant.client() as management:
        assert management.read("R", "TAKEN.NAME") == "hello"


def test_two_devices_exchange_structures(served_plant: ServedDevice, types: Path) -> None:
    port = endpoint(served_plant).rpartition(":")[2]
    with serving(folders=[types]) as device, device.client() as management:
        build(management, "R", ASKING.replace("PORT", port))
        management.start("R")
        wait_for(management, "R", "SEEN.STATUS", lambda value: value == "OK", 60.0)
        management.write("R", "MADE.N", "17")

        def answered(value: str) -> bool:
            management.trigger("R", "MADE.REQ")
            return value == "17"

        wait_for(management, "R", "TAKEN.N", answered, 60.0)
        assert management.read("R", "TAKEN.NAME") == "first"


def test_a_server_with_another_structure_is_told(types: Path, caplog: pytest.LogCaptureFixture) -> None:
    port = free_port()

    def ask() -> None:
        with serving(folders=[types]) as device, device.client() as management:
            build(management, "R", ASKING.replace("PORT", str(port)))
            management.start("R")
            told = "LINE has the members FIRST there: expected FIRST, OTHERS"
            wait_for(management, "R", "MADE.N", lambda _: told in caplog.text, 60.0)

    async def scenario() -> None:
        server = Server()
        await server.init()
        server.set_endpoint(f"opc.tcp://127.0.0.1:{port}")
        fields = [structures104.new_struct_field("FIRST", ua.VariantType.Float)]
        kind, (encoding,) = await structures104.new_struct(server, 1, "LINE", fields)
        plant = await server.nodes.objects.add_object(1, "Plant")
        value = ua.Variant(ua.ExtensionObject(encoding.nodeid, bytes(4)), ua.VariantType.ExtensionObject)
        for name in ("Wanted", "Line"):
            await plant.add_variable(1, name, value, datatype=kind.nodeid)
        async with server:
            await asyncio.to_thread(ask)

    run(scenario)
