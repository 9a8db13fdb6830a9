"""System files: applications mapped to resources, and what is wrong in them, by line."""

from __future__ import annotations

import re

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.files.systems import read_system
from iec61499.inspection import inspect
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.runtime.resource import Resource
from tests.support.iec61499.block_files import Write, line_of

SYSTEM = """<?xml version="1.0" encoding="UTF-8"?>
<System Name="TEST">
  <VersionInfo Version="1.0" Author="A"/>
  <Application Name="APP">
    <SubAppNetwork>
      <FB Name="COUNT" Type="E_CTU" x="100.0" y="200.0"><Parameter Name="PV" Value="UINT#2"/></FB>
      <FB Name="LATCH" Type="iec61499::events::E_D_FF"/>
      <FB Name="ELSEWHERE" Type="E_SR"/>
      <SubApp Name="INNER">
        <SubAppInterfaceList>
          <SubAppEventInputs><SubAppEvent Name="GO" Type="Event"/></SubAppEventInputs>
        </SubAppInterfaceList>
        <SubAppNetwork>
          <FB Name="N" Type="E_CTU"/>
          <EventConnections><Connection Source="GO" Destination="N.CU"/></EventConnections>
        </SubAppNetwork>
      </SubApp>
      <Group Name="G"/>
      <EventConnections>
        <Connection Source="COUNT.CUO" Destination="LATCH.CLK"/>
        <Connection Source="COUNT.CUO" Destination="INNER.GO"/>
      </EventConnections>
      <DataConnections><Connection Source="COUNT.Q" Destination="LATCH.D"/></DataConnections>
    </SubAppNetwork>
  </Application>
  <Device Name="FORTE_PC" Type="FORTE_PC">
    <Parameter Name="MGR_ID" Value="&quot;localhost:61499&quot;"/>
    <Resource Name="RES" Type="EMB_RES">
      <FBNetwork>
        <FB Name="CYCLE" Type="E_CYCLE"><Parameter Name="DT" Value="T#10ms"/></FB>
        <EventConnections>
          <Connection Source="START.COLD" Destination="CYCLE.START"/>
          <Connection Source="CYCLE.EO" Destination="APP.COUNT.CU"/>
        </EventConnections>
      </FBNetwork>
    </Resource>
    <Resource Name="OTHER" Type="EMB_RES"/>
  </Device>
  <Mapping From="APP.COUNT" To="FORTE_PC.RES"/>
  <Mapping From="APP.LATCH" To="FORTE_PC.RES.LATCH"/>
  <Mapping From="APP.INNER" To="FORTE_PC.RES"/>
  <Segment Name="ETH" Type="Ethernet"/>
</System>
"""


@pytest.mark.parametrize("name", ["FORTE_PC.RES", "RES"])
def test_a_system_runs(write: Write, name: str) -> None:
    library = Library()
    system = library.load_system(write("test.sys", SYSTEM))
    assert system.devices[0].parameters[0].value == '"localhost:61499"'
    resource = Resource(resource_network(system, name), library)
    assert set(resource.names()) == {"START", "CYCLE", "COUNT", "LATCH", "INNER.N"}
    resource.start()
    resource.advance(25_000_000)
    assert [resource.read(n) for n in ("COUNT.CV", "LATCH.Q", "INNER.N.CV")] == [2, True, 2]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'To="FORTE_PC.RES"',
            'To="FORTE_PC.REST"',
            "mapping to unknown resource 'FORTE_PC.REST': expected FORTE_PC.RES",
        ),
        ('From="APP.COUNT"', 'From="APP.CUONT"', "mapping of unknown block 'APP.CUONT': expected APP.COUNT"),
        ('"COUNT.Q"', '"COUNT.QQ"', "connection COUNT.QQ -> LATCH.D: COUNT has no data output QQ: expected Q or CV"),
        ('Type="E_CTU" x', 'Type="E_CTV" x', "unknown block type E_CTV: expected E_CT"),
        ('"UINT#2"', '"UINT#-2"', "is out of the range of UINT"),
        ('Name="PV"', 'Name="PW"', "COUNT has no data input PW: expected PV"),
        ("APP.COUNT.CU", "APP.COUNT.CD", "COUNT has no event input CD: expected CU or R"),
        ('<FB Name="ELSEWHERE"', '<FB Name="LATCH"', "block LATCH is already declared in line 7"),
        ("<Segment", "<Sigment", "unknown element <Sigment> in <System>: expected <Application>, <Device>"),
    ],
)
def test_systems_that_are_wrong(write: Write, old: str, new: str, message: str) -> None:
    path = write("test.sys", SYSTEM, (old, new))
    library = Library()
    with pytest.raises(FunctionBlockError, match=re.escape(message)) as caught:
        Resource(resource_network(library.load_system(path), "RES"), library)
    assert caught.value.file == str(path)
    if "already declared" not in message:
        assert caught.value.line == line_of(new, path)


def test_connections_to_blocks_without_a_place_are_left_out_and_said(write: Write) -> None:
    path = write("test.sys", SYSTEM, ('<Mapping From="APP.LATCH" To="FORTE_PC.RES.LATCH"/>', ""))
    library = Library()
    system = library.load_system(path)
    unmapped = [
        f"{path}:{line}: block {name} of APP, as it is mapped to no resource"
        for line, name in ((7, "LATCH"), (8, "ELSEWHERE"))
    ]
    assert system.left_out == (
        *unmapped,
        f"{path}:{line_of('LATCH.CLK', path)}: COUNT.CUO -> LATCH.CLK, as LATCH is mapped to no resource",
        f"{path}:{line_of('LATCH.D', path)}: COUNT.Q -> LATCH.D, as LATCH is mapped to no resource",
    )
    assert inspect(path, library).warnings == tuple(f"left out: {line}" for line in system.left_out)
    resource = Resource(resource_network(system, "RES"), library)
    resource.start()
    resource.advance(20_000_000)
    assert (resource.read("COUNT.Q"), resource.read("INNER.N.CV")) == (True, 2)
    assert library.load_system(write("test.sys", SYSTEM)).left_out == (
        f"{path}:8: block ELSEWHERE of APP, as it is mapped to no resource",
    )


def test_connections_between_resources_are_refused_without_communication_blocks(write: Write) -> None:
    path = write("test.sys", SYSTEM, ('To="FORTE_PC.RES.LATCH"', 'To="FORTE_PC.OTHER"'))
    with pytest.raises(FunctionBlockError, match=r"of application APP leaves resource FORTE_PC\.RES") as caught:
        resource_network(read_system(path), "RES")
    assert caught.value.line == line_of("LATCH.CLK", path)


def test_resources_are_named(write: Write) -> None:
    system = Library().load_system(write("test.sys", SYSTEM))
    with pytest.raises(FunctionBlockError, match=r"unknown resource 'X': expected FORTE_PC\.RES or FORTE_PC\.OTHER"):
        resource_network(system, "X")
    with pytest.raises(FunctionBlockError, match="more than one resource fits: expected"):
        resource_network(system)
