"""`dtwin fb run` with a program that is a test: it ends by itself, and its status says how."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from dtwin.cli import main
from tests.commands.test_fb_command import PATIENCE, device

CHECKED = """
;<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>
R;<Request ID="2" Action="CREATE"><FB Name="WAIT" Type="E_DELAY" /></Request>
R;<Request ID="3" Action="WRITE"><Connection Source="T#5ms" Destination="WAIT.DT" /></Request>
R;<Request ID="4" Action="CREATE"><FB Name="CHECK" Type="TEST_CONDITION" /></Request>
R;<Request ID="5" Action="WRITE"><Connection Source="RESULT" Destination="CHECK.check" /></Request>
R;<Request ID="6" Action="CREATE"><FB Name="END" Type="STEST_END" /></Request>
R;<Request ID="7" Action="CREATE"><Connection Source="START.COLD" Destination="FIRST" /></Request>
R;<Request ID="8" Action="CREATE"><Connection Source="WAIT.EO" Destination="CHECK.REQ" /></Request>
R;<Request ID="9" Action="CREATE"><Connection Source="CHECK.CNF" Destination="END.REQ" /></Request>
R;<Request ID="10" Action="START"/>
"""
FAILING = """
R;<Request ID="20" Action="CREATE"><FB Name="L" Type="FAILING" /></Request>
R;<Request ID="21" Action="CREATE"><Connection Source="START.COLD" Destination="L.REQ" /></Request>
"""
TYPE = """<FBType Name="FAILING"><InterfaceList><EventInputs><Event Name="REQ"/></EventInputs></InterfaceList>
<SimpleFB><Algorithm Name="REQ"><ST>WHILE TRUE DO ; END_WHILE;</ST></Algorithm></SimpleFB></FBType>"""


def boot(folder: Path, text: str) -> str:
    (folder / "FAILING.fbt").write_text(TYPE)
    path = folder / "test.fboot"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize("first", ["CHECK.REQ", "WAIT.START"])
@pytest.mark.parametrize(
    ("result", "status", "said"),
    [
        ("TRUE", 0, "resource R ended: test passed; checks made: 1"),
        ("FALSE", 1, "resource R ended: test failed at CHECK; checks made: 1"),
    ],
)
def test_a_boot_file_that_is_a_test_ends_with_its_status(
    first: str, result: str, status: int, said: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = boot(tmp_path, CHECKED.replace("RESULT", result).replace("FIRST", first))
    assert main(["fb", "run", file, "--listen", "127.0.0.1:0"]) == status
    assert [record.message for record in caplog.records if "ended" in record.message] == [said]


def test_a_system_that_is_a_test_ends_with_its_status(tmp_path: Path) -> None:
    file = tmp_path / "test.sys"
    file.write_text(
        '<System Name="T"><Device Name="D" Type="FORTE_PC"><Resource Name="R" Type="EMB_RES"><FBNetwork>'
        '<FB Name="CHECK" Type="TEST_CONDITION"/><FB Name="END" Type="STEST_END"/><EventConnections>'
        '<Connection Source="START.COLD" Destination="CHECK.REQ"/>'
        '<Connection Source="CHECK.CNF" Destination="END.REQ"/>'
        "</EventConnections></FBNetwork></Resource></Device></System>"
    )
    assert main(["fb", "run", str(file), "--listen", "127.0.0.1:0"]) == 1, "an input that nothing is given is FALSE"


def test_a_test_whose_resource_ends_in_an_error_has_failed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    lines = CHECKED.replace("RESULT", "TRUE").replace("FIRST", "WAIT.STOP").strip().splitlines()
    file = boot(tmp_path, "\n".join([*lines[:-1], FAILING, lines[-1]]))
    assert main(["fb", "run", file, "--listen", "127.0.0.1:0"]) == 1
    assert "L.REQ: loop did not end" in caplog.text


def test_a_device_whose_only_resource_has_failed_says_so_when_it_is_stopped(tmp_path: Path) -> None:
    create, start = CHECKED.strip().splitlines()[0], 'R;<Request ID="9" Action="START"/>'
    failing = [create, FAILING, start]
    beside = [line.replace('"R"', '"S"').replace("R;", "S;") for line in (create, start)]
    for lines, status in ((failing, 1), ([*beside, *failing], 0)):
        with device(boot(tmp_path, "\n".join(lines))) as (process, _):
            process.send_signal(signal.SIGTERM)
            assert process.wait(PATIENCE) == status
