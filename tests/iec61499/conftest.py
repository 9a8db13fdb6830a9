"""Files of block types written with changes, and devices that serve."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from dtwin.parameters import ROOT
from iec61499.library import Library
from iec61499.net.address import LocalAddress, StreamAddress
from tests.support.iec61499.block_files import Write
from tests.support.iec61499.served_device import ANY_PORT, ServedDevice


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_file(name: str, text: str, *changes: tuple[str, str]) -> Path:
        for old, new in changes:
            assert text.count(old) >= 1, old
            text = text.replace(old, new, 1)
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write_file


DOUBLER = """<?xml version="1.0" encoding="UTF-8"?>
<FBType Name="DOUBLER" Comment="">
  <Identification Standard="61499-2"/>
  <VersionInfo Version="1.0"/>
  <InterfaceList>
    <EventInputs><Event Name="REQ"><With Var="X"/></Event></EventInputs>
    <EventOutputs><Event Name="CNF"><With Var="Y"/></Event></EventOutputs>
    <InputVars><VarDeclaration Name="X" Type="LREAL"/></InputVars>
    <OutputVars><VarDeclaration Name="Y" Type="LREAL"/></OutputVars>
  </InterfaceList>
  <BasicFB>
    <ECC>
      <ECState Name="START" x="0" y="0"/>
      <ECState Name="DO" x="0" y="0"><ECAction Algorithm="DOUBLE" Output="CNF"/></ECState>
      <ECTransition Source="START" Destination="DO" Condition="REQ" x="0" y="0"/>
      <ECTransition Source="DO" Destination="START" Condition="1" x="0" y="0"/>
    </ECC>
    <Algorithm Name="DOUBLE"><ST><![CDATA[Y := 2.0 * X;]]></ST></Algorithm>
  </BasicFB>
</FBType>
"""


@pytest.fixture
def library(tmp_path: Path) -> Library:
    (tmp_path / "DOUBLER.fbt").write_text(DOUBLER)
    return Library([tmp_path])


@pytest.fixture(params=["TCP", "Unix domain socket"])
def stream_address(request: pytest.FixtureRequest) -> Iterator[StreamAddress]:
    """Where something can listen, once of each kind; the folder of the socket is short, as its path has to be."""
    with TemporaryDirectory() as folder:
        yield ANY_PORT if request.param == "TCP" else LocalAddress(Path(folder), 61499)


@pytest.fixture
def management() -> StreamAddress:
    """Where devices are managed; a module that tries other addresses has a fixture of its own."""
    return ANY_PORT


@pytest.fixture
def served(library: Library, management: StreamAddress) -> Iterator[ServedDevice]:
    served = ServedDevice(library, management)
    served.start()
    yield served
    served.stop()


@pytest.fixture
def cell(tmp_path: Path, management: StreamAddress) -> Iterator[ServedDevice]:
    """A device with the control application of the cell, on TCP ports that the operating system chooses."""
    library = Library([ROOT / "fb"])
    system = tmp_path / "cell.sys"
    text = (ROOT / "fb" / "dtwin.sys").read_text()
    in_folder = isinstance(management, LocalAddress)
    system.write_text(text if in_folder else re.sub(r"localhost:615\d\d", "localhost:0", text))
    served = ServedDevice(library, management)
    served.device.load_system(library.load_system(system))
    served.start()
    yield served
    served.stop()
