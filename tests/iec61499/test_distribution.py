"""Applications whose blocks are mapped to several devices."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.runtime.communication import LocalTransport
from iec61499.runtime.resource import Resource
from iec61499.types import UINT

SYSTEM = """<System Name="two"><Application Name="App"><SubAppNetwork>
<FB Name="CYC" Type="E_CYCLE"><Parameter Name="DT" Value="T#100ms"/></FB>
<FB Name="CTU" Type="E_CTU"><Parameter Name="PV" Value="3"/></FB>
<FB Name="SUM" Type="F_ADD"><Parameter Name="IN2" Value="UINT#1000"/></FB>
<FB Name="SW" Type="E_SWITCH"/>
<EventConnections>
<Connection Source="CYC.EO" Destination="CTU.CU"/><Connection Source="CTU.CUO" Destination="SUM.REQ"/>
<Connection Source="CTU.CUO" Destination="SW.EI"/><Connection Source="CTU.RO" Destination="SUM.REQ"/>
<Connection Source="SW.EO1" Destination="CTU.R"/>
</EventConnections>
<DataConnections>
<Connection Source="CTU.CV" Destination="SUM.IN1"/><Connection Source="CTU.Q" Destination="SW.G"/>
</DataConnections></SubAppNetwork></Application>
<Device Name="A" Type="FORTE_PC"><Parameter Name="MGR_ID" Value="&quot;localhost:1&quot;"/>
<Resource Name="RES" Type="EMB_RES"><FBNetwork>
<EventConnections><Connection Source="START.COLD" Destination="App.CYC.START"/></EventConnections>
</FBNetwork></Resource></Device>
<Device Name="B" Type="FORTE_PC"><Resource Name="RES" Type="EMB_RES">NETWORK</Resource></Device>
<Mapping From="App.CYC" To="A.RES"/><Mapping From="App.CTU" To="A.RES.CTU"/>
<Mapping From="App.SUM" To="B.RES"/><Mapping From="App.SW" To="B.RES"/>
</System>"""
HOST = '<Parameter Name="MGR_ID" Value="127.0.0.1:2"/>'
COUNTS = """<FBType Name="COUNTS"><InterfaceList>
<EventInputs><Event Name="CU"/><Event Name="R"/></EventInputs>
<EventOutputs><Event Name="CUO"><With Var="CV"/></Event><Event Name="RO"/></EventOutputs>
<InputVars><VarDeclaration Name="PV" Type="UINT"/></InputVars>
<OutputVars><VarDeclaration Name="CV" Type="UINT" ArraySize="2"/><VarDeclaration Name="Q" Type="BOOL"/></OutputVars>
</InterfaceList><SimpleFB/></FBType>"""
OWN = """<FBNetwork><FB Name="SUB" Type="SUBSCRIBE_2"/>
<EventConnections><Connection Source="SUB.IND" Destination="SUM.REQ"/>
<Connection Source="SUB.IND" Destination="App.SW.EI"/></EventConnections>
<DataConnections><Connection Source="SUB.RD_1" Destination="SUM.IN1"/>
<Connection Source="SUB.RD_2" Destination="SW.G"/></DataConnections></FBNetwork>"""


def load(tmp_path: Path, text: str, acknowledged: bool = False) -> tuple[Library, list[Resource]]:
    path = tmp_path / "two.sys"
    path.write_text(text)
    library = Library([tmp_path])
    system = library.load_system(path, acknowledged)
    local = LocalTransport()
    names = [f"{device.name}.{resource.name}" for device in system.devices for resource in device.resources]
    return library, [Resource(resource_network(system, name), library, local) for name in names]


@pytest.mark.parametrize("acknowledged", [False, True])
def test_blocks_on_two_devices_work_as_on_one(tmp_path: Path, acknowledged: bool) -> None:
    one_text = SYSTEM.replace("NETWORK", "").replace('To="B.RES"', 'To="A.RES"')
    _, (one, _) = load(tmp_path, one_text)
    addressed = SYSTEM.replace("NETWORK", "").replace('"B" Type="FORTE_PC">', f'"B" Type="FORTE_PC">{HOST}')
    _, (first, second) = load(tmp_path, addressed, acknowledged)
    for resource in (one, first, second):
        resource.start()
    seen = []
    for _ in range(10):
        one.advance(100_000_000)
        first.advance(100_000_000)
        while not (first.is_idle and second.is_idle):
            second.run_until_idle()
            first.run_until_idle()
        assert (first.read("CTU.CV"), second.read("SUM.OUT")) == (one.read("CTU.CV"), one.read("SUM.OUT"))
        seen.append(second.read("SUM.OUT"))
    assert seen == [1001, 1002, 1000, 1001, 1002, 1000, 1001, 1002, 1000, 1001]


def test_acknowledged_events_wait_until_their_peer_is_there_and_come_once_and_in_order(tmp_path: Path) -> None:
    text = SYSTEM.replace("NETWORK", "").replace('"B" Type="FORTE_PC">', f'"B" Type="FORTE_PC">{HOST}')
    _, (first, second) = load(tmp_path, text, acknowledged=True)
    first.start()
    first.advance(250_000_000)
    assert (first.read("CTU.CV"), first.read("TO_B_RES.COUNT")) == (2, 2)
    second.start()
    received: list[int] = []
    for _ in range(14):
        first.advance(10_000_000)
        second.run_until_idle()
        if received[-1:] != [second.read("SUM.OUT")]:
            received.append(second.read("SUM.OUT"))
        first.run_until_idle()
    # one event for each answer: nothing is skipped although two had waited
    assert received == [0, 1001, 1002, 1003, 1000]
    assert first.read("TO_B_RES.COUNT") == 0
    second.stop()
    second.reset()
    first.advance(400_000_000)
    assert first.read("TO_B_RES.OPEN") is False
    assert first.read("TO_B_RES.COUNT") == 4


def test_acknowledged_links_need_an_address_and_elementary_types(tmp_path: Path) -> None:
    with pytest.raises(FunctionBlockError, match="device B: MGR_ID has no host in figures"):
        load(tmp_path, SYSTEM.replace("NETWORK", ""), acknowledged=True)
    (tmp_path / "COUNTS.fbt").write_text(COUNTS)
    text = SYSTEM.replace("NETWORK", "").replace('"CTU" Type="E_CTU"', '"CTU" Type="COUNTS"')
    text = text.replace('"B" Type="FORTE_PC">', f'"B" Type="FORTE_PC">{HOST}')
    with pytest.raises(FunctionBlockError, match=r"acknowledged links do not carry ARRAY \[0\.\.1\] OF UINT"):
        load(tmp_path, text, acknowledged=True)


def test_inserted_blocks_are_said_and_have_addresses(tmp_path: Path) -> None:
    path = tmp_path / "two.sys"
    path.write_text(SYSTEM.replace("NETWORK", ""))
    system = Library([tmp_path]).load_system(path)
    assert system.inserted == (
        "B.RES -> A.RES: PUBLISH and SUBSCRIBE for SW.EO1",
        "A.RES -> B.RES: PUBLISH and SUBSCRIBE for CTU.CUO, CTU.RO, CTU.CV and CTU.Q",
    )
    blocks = {block.name: block for block in resource_network(system, "B.RES").blocks}
    ids = {name: {p.name: p.value for p in block.parameters}.get("ID") for name, block in blocks.items()}
    # B says no address, so it is reached by a group
    assert ids["FROM_A_RES"] == "'239.192.0.2:62001'"
    assert ids["TO_A_RES"] == "'127.0.0.1:62000'"


def test_connections_that_a_resource_serves_are_left_to_it(tmp_path: Path) -> None:
    path = tmp_path / "two.sys"
    path.write_text(SYSTEM.replace("NETWORK", OWN))
    system = Library([tmp_path]).load_system(path)
    assert system.inserted == ("B.RES -> A.RES: PUBLISH and SUBSCRIBE for SW.EO1",)
    blocks = [block.name for block in resource_network(system, "B.RES").blocks]
    assert blocks == ["START", "SUM", "SW", "SUB", "TO_A_RES"]


def test_a_mapping_to_nothing_is_named(tmp_path: Path) -> None:
    path = tmp_path / "two.sys"
    path.write_text(SYSTEM.replace("NETWORK", "").replace('To="A.RES.CTU"', 'To="C.RES.CTU"'))
    with pytest.raises(FunctionBlockError, match=r"mapping to unknown resource 'C\.RES\.CTU': expected A\.RES or B"):
        Library([tmp_path]).load_system(path)


@pytest.mark.parametrize("acknowledged", [False, True])
def test_a_generic_output_has_the_type_of_the_input_that_another_resource_gives_it(
    tmp_path: Path, acknowledged: bool
) -> None:
    text = """<System Name="two"><Application Name="App"><SubAppNetwork>
<FB Name="SERVED" Type="SERVER_1_2"><Parameter Name="QI" Value="TRUE"/>
<Parameter Name="ID" Value="'127.0.0.1:61500'"/></FB><FB Name="CTU" Type="E_CTU"/>
<EventConnections><Connection Source="SERVED.IND" Destination="CTU.CU"/>
<Connection Source="CTU.CUO" Destination="SERVED.RSP"/></EventConnections>
<DataConnections><Connection Source="SERVED.RD_2" Destination="CTU.PV"/>
<Connection Source="CTU.CV" Destination="SERVED.SD_1"/></DataConnections></SubAppNetwork></Application>
<Device Name="A" Type="FORTE_PC"><Parameter Name="MGR_ID" Value="127.0.0.1:1"/>
<Resource Name="RES" Type="EMB_RES"><FBNetwork/></Resource></Device>
<Device Name="B" Type="FORTE_PC"><Parameter Name="MGR_ID" Value="127.0.0.1:2"/>
<Resource Name="RES" Type="EMB_RES"><FBNetwork/></Resource></Device>
<Mapping From="App.SERVED" To="A.RES"/><Mapping From="App.CTU" To="B.RES"/></System>"""
    path = tmp_path / "two.sys"
    path.write_text(text)
    system = Library([tmp_path]).load_system(path, acknowledged)
    served = next(block for block in system.applications[0].network.blocks if block.name == "SERVED")
    assert served.types == (("RD_2", UINT),)
