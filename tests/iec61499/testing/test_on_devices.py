"""`fb test` on a device: programs to their STEST_END, service sequences, and what the device does not have."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.testing import block, programs, session
from iec61499.testing.runtimes import Inapplicable
from iec61499.testing.sequences import Failed, read_sequences, run_sequence
from tests.support.forte import FORTE, NO_FORTE, forte
from tests.support.iec61499.counter import HOLDS, WRONG, write_counter
from tests.support.iec61499.served_device import ServedDevice
from tests.support.iec61499.surveys import service_sequences
from tests.support.waiting import connected

NEEDS_FORTE = pytest.mark.skipif(not FORTE, reason=NO_FORTE)
BOOT = """;<Request ID="1" Action="CREATE"><FB Name="CHECKED" Type="EMB_RES" /></Request>
CHECKED;<Request ID="2" Action="CREATE"><FB Name="CYCLE" Type="E_CYCLE" /></Request>
CHECKED;<Request ID="3" Action="CREATE"><FB Name="COUNT" Type="E_CTU" /></Request>
CHECKED;<Request ID="4" Action="CREATE"><FB Name="CHECK" Type="TEST_CONDITION" /></Request>
CHECKED;<Request ID="5" Action="CREATE"><FB Name="LAST" Type="E_SWITCH" /></Request>
CHECKED;<Request ID="6" Action="CREATE"><FB Name="END" Type="STEST_END" /></Request>
CHECKED;<Request ID="7" Action="WRITE"><Connection Source="T#5ms" Destination="CYCLE.DT" /></Request>
CHECKED;<Request ID="8" Action="WRITE"><Connection Source="3" Destination="COUNT.PV" /></Request>
CHECKED;<Request ID="9" Action="CREATE"><Connection Source="START.COLD" Destination="CYCLE.START" /></Request>
CHECKED;<Request ID="10" Action="CREATE"><Connection Source="CYCLE.EO" Destination="COUNT.CU" /></Request>
CHECKED;<Request ID="11" Action="CREATE"><Connection Source="COUNT.CUO" Destination="LAST.EI" /></Request>
CHECKED;<Request ID="12" Action="CREATE"><Connection Source="COUNT.Q" Destination="LAST.G" /></Request>
CHECKED;<Request ID="13" Action="CREATE"><Connection Source="LAST.EO1" Destination="CHECK.REQ" /></Request>
CHECKED;<Request ID="14" Action="CREATE"><Connection Source="CHECK.CNF" Destination="END.REQ" /></Request>
CHECKED;<Request ID="15" Action="WRITE"><Connection Source="TRUE" Destination="CHECK.check" /></Request>
CHECKED;<Request ID="16" Action="CREATE"><Connection Source="LAST.EO1" Destination="CYCLE.STOP" /></Request>
CHECKED;<Request ID="17" Action="START"/>
"""
WITHOUT_Q = '<Connection Source="LAST.EO1" Destination="CHECK.REQ" />'
ALL_EVENTS = (
    WITHOUT_Q.replace("LAST.EO1", "COUNT.CUO")
    + '</Request>\nCHECKED;<Request ID="20" Action="CREATE">'
    + '<Connection Source="LAST.EO1" Destination="END.REQ" />'
)
LITERAL = '<Request ID="15" Action="WRITE"><Connection Source="TRUE" Destination="CHECK.check" />'
COUNTED = LITERAL.replace("WRITE", "CREATE").replace("TRUE", "COUNT.Q")
SYSTEM = """<System Name="checked"><Application Name="A"><SubAppNetwork>
<FB Name="COUNTER" Type="COUNTER"><Parameter Name="PV" Value="1"/></FB>
<FB Name="CHECK" Type="TEST_CONDITION"/>
<FB Name="END" Type="STEST_END"/>
<EventConnections><Connection Source="COUNTER.CUO" Destination="CHECK.REQ"/>
<Connection Source="CHECK.CNF" Destination="END.REQ"/></EventConnections>
<DataConnections><Connection Source="COUNTER.Q" Destination="CHECK.check"/></DataConnections>
</SubAppNetwork></Application>
<Device Name="D" Type="FORTE_PC"><Resource Name="R" Type="EMB_RES"><FBNetwork><EventConnections>
<Connection Source="START.COLD" Destination="A.COUNTER.CU"/></EventConnections></FBNetwork></Resource></Device>
<Mapping From="A.COUNTER" To="D.R"/><Mapping From="A.CHECK" To="D.R"/><Mapping From="A.END" To="D.R"/></System>"""
SERVICE = """<FBType Name="PLATFORM_ONLY"><InterfaceList><EventInputs><Event Name="INIT"/></EventInputs>
<EventOutputs><Event Name="INITO"/></EventOutputs></InterfaceList>
<Service LeftInterface="A" RightInterface="R"><ServiceSequence Name="establishes"><ServiceTransaction>
<InputPrimitive Interface="A" Event="INIT"/><OutputPrimitive Interface="A" Event="INITO"/>
</ServiceTransaction></ServiceSequence></Service></FBType>"""
LATE = """<ServiceSequence Name="late"><ServiceTransaction>
<InputPrimitive Interface="E" Event="START" Parameters="DT:=T#300ms"/>
<OutputPrimitive Interface="E" Event="EO"/></ServiceTransaction></ServiceSequence>"""


@pytest.fixture(params=["embedded", pytest.param("forte", marks=NEEDS_FORTE)])
def device(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A session of tests on the embedded device, whose folder has the types, then on a 4diac FORTE."""
    write_counter(tmp_path, HOLDS, WRONG, LATE)
    if request.param == "embedded":
        served: ServedDevice = request.getfixturevalue("served")
        monkeypatch.setattr(session, "current", session.Session(str(served.management.address)))
        yield request.param
        session.current.end()
        return
    with forte(tmp_path) as address:
        monkeypatch.setattr(session, "current", session.Session(str(address)))
        connected(session.current.client)
        yield request.param
        session.current.end()


def verdict(file: Path, text: str) -> str:
    """What is said of a program: nothing when it passes."""
    file.write_text(text)
    try:
        programs.run_program(file)
    except FunctionBlockError as error:
        return str(error).removeprefix(f"{file}: ")
    return ""


def test_boot_files_run_to_their_end_and_the_device_goes_on(device: str, tmp_path: Path) -> None:
    file = tmp_path / "checked.fboot"
    assert verdict(file, BOOT) == ""
    assert verdict(file, BOOT.replace(LITERAL, LITERAL.replace("TRUE", "FALSE"))).startswith("test failed at CHECK")
    assert verdict(file, BOOT.replace(LITERAL, COUNTED)) == ""
    # at the first two events the count is not reached yet: two of three checks fail, though the last one passes
    failing = BOOT.replace(LITERAL, COUNTED).replace(WITHOUT_Q, ALL_EVENTS).replace("CHECK.CNF", "CHECK.REQ")
    failing = "\n".join(line for line in failing.split("\n") if 'Source="CHECK.REQ"' not in line)
    assert verdict(file, failing) == "test failed at CHECK; checks made: 3"
    assert [each.name for each in session.current.client().blocks("")] == []


def test_what_the_device_refuses_is_told_with_its_line(device: str, tmp_path: Path) -> None:
    file = tmp_path / "unknown.fboot"
    assert verdict(file, BOOT.replace("E_CTU", "NO_SUCH_TYPE")).startswith(f"{file}:3: ")
    assert [each.name for each in session.current.client().blocks("")] == []


def test_a_resource_that_is_there_is_not_touched(device: str, tmp_path: Path) -> None:
    client = session.current.client()
    client.create_block("", "CHECKED", "EMB_RES")
    assert "has a resource CHECKED already" in verdict(tmp_path / "checked.fboot", BOOT)
    assert [each.name for each in client.blocks("")] == ["CHECKED"]


def test_systems_of_one_device_run_there(device: str, tmp_path: Path) -> None:
    file = tmp_path / "checked.sys"
    assert verdict(file, SYSTEM) == ""
    assert verdict(file, SYSTEM.replace('Value="1"', 'Value="2"')) == "test failed at CHECK; checks made: 1"
    file.write_text(SYSTEM.replace("<Mapping", '<Device Name="E" Type="FORTE_PC"/><Mapping', 1))
    with pytest.raises(Inapplicable, match="has 2 devices: expected one"):
        programs.run_program(file)


def test_sequences_run_there_and_wait_for_what_comes_later(device: str, tmp_path: Path) -> None:
    holds, wrong, late = read_sequences(tmp_path / "COUNTER.fbt")
    counter = Library([tmp_path]).find("COUNTER")
    run_sequence(holds, counter)
    with pytest.raises(Failed, match="expected CUO with CV:=3, got CV:=1"):
        run_sequence(wrong, counter)
    run_sequence(late, Library([tmp_path]).find("E_DELAY"))


def test_a_service_that_the_device_lacks_is_left_out(device: str, tmp_path: Path) -> None:
    file = tmp_path / "PLATFORM_ONLY.fbt"
    file.write_text(SERVICE)
    with pytest.raises(Inapplicable, match="the device has no type PLATFORM_ONLY"):
        run_sequence(read_sequences(file)[0], Library([tmp_path]).find("PLATFORM_ONLY"))


def test_two_blocks_of_one_test_stand_side_by_side(device: str, tmp_path: Path) -> None:
    first, second = block("COUNTER", tmp_path, PV=5), block("COUNTER", tmp_path, PV=7)
    assert first.CU(R=False) == second.CU(R=False) == ("CUO",)
    assert first.CU() == ("CUO",)
    assert (first.CV, second.CV) == (2, 1)
    session.current.close()
    assert [each.name for each in session.current.client().blocks("")] == []


def test_the_table_of_a_library_tells_each_sequence_and_why(
    device: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_counter(tmp_path, WRONG)
    (tmp_path / "DELAYS.fbt").write_text(SERVICE.replace("PLATFORM_ONLY", "DELAYS"))
    session.current.end()
    monkeypatch.setattr("sys.argv", ["service-sequences", str(tmp_path), "--device", session.current.runtime])
    assert service_sequences.main() == 0
    said = capsys.readouterr().out
    assert "| COUNTER.wrong | fail | fail | after CU expected CUO with CV:=3, got CV:=1 |" in said
    assert "| 1 | it is a service that this runtime does not have; the device has no type it |" in said
    assert "embedded: 1 fail, 1 left out of 2" in said
