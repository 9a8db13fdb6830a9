"""What blocks are called on a device: as 4diac IDE calls them, which monitors them by these names."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.deploy.plan import plan_deployment
from iec61499.inspection import inspect
from iec61499.library import Library
from iec61499.management.bootfile import print_boot_file
from iec61499.mapping import device_network, resource_network
from iec61499.runtime.resource import Resource
from tests.support.iec61499.block_files import Write

SYSTEM = """<System Name="S"><VersionInfo Version="1.0" Author="A"/>
 <Application Name="ONE"><SubAppNetwork>
  <FB Name="TEXT" Type="STRING2STRING"><Parameter Name="IN" Value="'a'"/></FB>
  <FB Name="N" Type="E_CTU"/>
  <SubApp Name="TOGGLE"><SubAppInterfaceList>
    <SubAppEventInputs><SubAppEvent Name="GO"/></SubAppEventInputs>
    <SubAppEventOutputs><SubAppEvent Name="DONE"/></SubAppEventOutputs>
    <InputVars><VarDeclaration Name="PV" Type="UINT" InitialValue="4"/></InputVars>
   </SubAppInterfaceList><SubAppNetwork>
    <FB Name="SW" Type="E_CTU"/>
    <EventConnections>
     <Connection Source="GO" Destination="SW.CU"/><Connection Source="SW.CUO" Destination="DONE"/>
    </EventConnections>
    <DataConnections><Connection Source="PV" Destination="SW.PV"/></DataConnections>
   </SubAppNetwork></SubApp>
  <EventConnections>
   <Connection Source="TEXT.CNF" Destination="TOGGLE.GO"/>
   <Connection Source="TOGGLE.DONE" Destination="N.CU"/>
  </EventConnections>
 </SubAppNetwork></Application>
 <Application Name="TWO"><SubAppNetwork><FB Name="N" Type="E_CTU"/></SubAppNetwork></Application>
 <Device Name="D" Type="FORTE_PC"><Resource Name="R" Type="EMB_RES"><FBNetwork>
  <FB Name="CYCLE" Type="E_CYCLE"><Parameter Name="DT" Value="T#1s"/></FB>
  <EventConnections>
   <Connection Source="START.COLD" Destination="CYCLE.START"/>
   <Connection Source="CYCLE.EO" Destination="TEXT.REQ"/>
   <Connection Source="CYCLE.EO" Destination="TWO.N.CU"/>
  </EventConnections>
 </FBNetwork></Resource></Device>
 <Mapping From="ONE.TEXT" To="D.R.TEXT"/><Mapping From="ONE.N" To="D.R"/>
 <Mapping From="ONE.TOGGLE.SW" To="D.R"/><Mapping From="TWO.N" To="D.R.N_1"/>
</System>"""


def test_requests_name_blocks_as_4diac_ide_does(write: Write) -> None:
    library = Library()
    network = device_network(library.load_system(write("S.sys", SYSTEM)))
    commands = plan_deployment("R", network, library).commands
    lines = print_boot_file(commands).splitlines()
    requests = {line.partition(' Action="')[2] for line in lines}
    for name, kind in {
        "ONE.TEXT": "STRING2STRING",
        "ONE.N": "E_CTU",
        "ONE.TOGGLE.SW": "E_CTU",
        "TWO.N": "E_CTU",
        "CYCLE": "E_CYCLE",
    }.items():
        assert any(f'<FB Name="{name}" Type="{kind}' in request for request in requests), name
    ends = ("START.COLD CYCLE.START", "CYCLE.EO ONE.TEXT.REQ", "CYCLE.EO TWO.N.CU", "ONE.TEXT.CNF ONE.TOGGLE.SW.CU")
    for source, destination in (pair.split() for pair in (*ends, "ONE.TOGGLE.SW.CUO ONE.N.CU")):
        wire = f'CREATE"><Connection Source="{source}" Destination="{destination}"'
        assert any(request.startswith(wire) for request in requests), wire
    assert any('WRITE"><Connection Source="4" Destination="ONE.TOGGLE.SW.PV"' in request for request in requests)


def test_a_block_inside_an_untyped_subapplication_is_mapped_by_itself(write: Write) -> None:
    library = Library()
    resource = Resource(resource_network(library.load_system(write("S.sys", SYSTEM))), library)
    # a program in this process calls a block by its own name, unless another one is called so
    assert set(resource.names()) == {"START", "CYCLE", "TEXT", "ONE.N", "TWO.N", "TOGGLE.SW"}
    resource.start()
    resource.advance(1_000_000_000)
    assert [resource.read(f"{name}.CV") for name in ("TOGGLE.SW", "ONE.N", "TWO.N")] == [1, 1, 1]
    assert resource.read("TOGGLE.SW.PV") == 4


def test_a_name_that_several_blocks_have_is_not_guessed(write: Write) -> None:
    path = write("S.sys", SYSTEM, ('"TWO.N.CU"', '"N.CU"'), ("D.R.N_1", "D.R"))
    with pytest.raises(FunctionBlockError, match=r"N\.CU: D\.R has more than one block N: expected ONE\.N or TWO\.N"):
        device_network(Library().load_system(path))


def test_what_runs_nowhere_is_said(write: Write) -> None:
    left = ('<Mapping From="ONE.N" To="D.R"/>', ""), ('<Mapping From="TWO.N" To="D.R.N_1"/>', "")
    path = write("S.sys", SYSTEM, *left, ('<Connection Source="CYCLE.EO" Destination="TWO.N.CU"/>', ""))
    found = inspect(path, Library())
    assert found.problems == ()
    assert [line.partition(f"{path}:")[2].partition(" ")[2] for line in found.warnings] == [
        "block N of ONE, as it is mapped to no resource",
        "TOGGLE.SW.CUO -> N.CU, as N is mapped to no resource",
        "application TWO, as none of its 1 blocks is mapped to a resource",
    ]


def test_all_mistakes_of_a_system_are_said_at_once(write: Write) -> None:
    path = write(
        "S.sys",
        SYSTEM,
        ('Destination="TOGGLE.GO"', 'Destination="TOGGLE.GOO"'),
        ('Source="TOGGLE.DONE"', 'Source="TOGGEL.DONE"'),
        ('Name="IN" Value', 'Name="INN" Value'),
        ('"E_CTU"/></SubAppNetwork>', '"E_CTUU"/></SubAppNetwork>'),
        ('"T#1s"', '"soon"'),
        ('"ONE.TEXT" To="D.R.TEXT"', '"ONE.TXT" To="D.R.TEXT"'),
        ('From="TWO.N" To="D.R', 'From="TWO.N" To="D.RR'),
    )
    said = " / ".join(str(problem) for problem in inspect(path, Library()).problems)
    for part in ("GOO", "TOGGEL", "INN", "E_CTUU", "soon", "ONE.TXT", "D.RR"):
        assert part in said, part


PROTOCOLS = """<System Name="P"><VersionInfo Version="1.0" Author="A"/>
 <Device Name="D" Type="FORTE_PC"><Resource Name="R" Type="EMB_RES"><FBNetwork>
  <FB Name="OPC" Type="CLIENT_1_1"><Parameter Name="ID" Value="opc_ua[CREATE;opc.tcp://x:4840#;/a]"/></FB>
  <FB Name="CSV" Type="SERVER_1_1"><Parameter Name="ID" Value="csv[].ip[localhost:61900]"/></FB>
  <FB Name="GOOD" Type="SERVER_1_1"><Parameter Name="ID" Value="fbdk[].ip[localhost:61901]"/></FB>
  <FB Name="NEAR" Type="PUBL_1"><Parameter Name="ID" Value="channel"/></FB>
 </FBNetwork></Resource></Device></System>"""


def test_blocks_whose_protocol_is_not_here_are_named(write: Write) -> None:
    warnings = inspect(write("P.sys", PROTOCOLS), Library()).warnings
    assert [line.split(": ")[1] for line in warnings] == ["OPC", "CSV"]
    assert "opc_ua[CREATE" in warnings[0]


def test_start_in_an_application_that_runs_nowhere_is_a_warning(write: Write, tmp_path: Path) -> None:
    path = write(
        "S.sys",
        SYSTEM,
        (
            '<Connection Source="TEXT.CNF"',
            '<Connection Source="START.COLD" Destination="N.R"/>\n<Connection Source="TEXT.CNF"',
        ),
    )
    found = inspect(path, Library())
    assert found.problems == ()
    assert "START.COLD -> N.R of an application: START is a block of each resource" in found.warnings[0]
