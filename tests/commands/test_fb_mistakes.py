"""What a new user of the block commands does wrong: each is one line that names the place and what was expected."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtwin.cli import main

SYSTEM = """<System Name="S">
<Device Name="D" Type="FORTE_PC"><Resource Name="R" Type="EMB_RES"><FBNetwork>
<FB Name="C" Type="E_CTU"/>
<FB Name="W" Type="E_DELAY"/>
<EventConnections><Connection Source="START.COLD" Destination="C.CU"/></EventConnections>
<DataConnections><Connection Source="C.CV" Destination="W.DT"/></DataConnections>
</FBNetwork></Resource></Device></System>
"""
FITTING = SYSTEM.replace('<Connection Source="C.CV" Destination="W.DT"/>', "")
CREATE = ';<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>\n'


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        (SYSTEM, 6, "C.CV"),
        (FITTING.replace("E_DELAY", "E_DELAYED"), 4, "unknown block type E_DELAYED: expected E_DELAY"),
        (FITTING.replace('Name="W"', 'Name="C"'), 4, "C is already declared in line 3"),
        (FITTING.replace('"C.CU"', '"C.CO"'), 5, "C.CO"),
        (FITTING.replace('"C.CU"', '"X.CU"'), 5, "X"),
    ],
)
def test_a_mistake_in_a_system_is_told_with_its_line(
    text: str, line: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "s.sys"
    file.write_text(text)
    assert main(["fb", "check", str(file)]) == 1
    told, summary = capsys.readouterr().out.splitlines()
    assert told.startswith(f"{file}:{line}")
    assert said in told
    assert summary == "files: 1, problems: 1"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (CREATE + 'R;<Request ID="2" Action="CREATE"><FB Name="C" Ty', "s.fboot:2"),
        (CREATE + 'Q;<Request ID="2" Action="START"/>\n', "s.fboot:2: START refused"),
        (CREATE + CREATE, "s.fboot:2: CREATE block R of type EMB_RES refused: INVALID_STATE"),
        (CREATE.replace("EMB_RES", "EMB_REZ"), "resource type 'EMB_REZ': expected EMB_RES"),
        (SYSTEM, "s.fboot:1: expected RESOURCE;<Request ...>"),
    ],
)
def test_a_mistake_in_a_boot_file_is_told_with_its_line(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "s.fboot"
    file.write_text(text)
    assert main(["fb", "run", str(file), "--listen", "127.0.0.1:0"]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1
