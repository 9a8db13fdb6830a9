"""A cell whose controller is a 4diac FORTE."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from dtwin.cell import Cell, CellSettings
from dtwin.recording import read_log
from tests.services.bench import ROOT, free_port

FORTE = os.environ.get("FORTE")


@pytest.mark.skipif(FORTE is None, reason="set FORTE to the path of a 4diac FORTE with Lua types to run this")
def test_a_forte_moves_the_arm_as_the_embedded_device_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    log, address = tmp_path / "run.parquet", f"127.0.0.1:{free_port()}"
    forte = subprocess.Popen([str(FORTE), "-c", address], cwd=tmp_path, stdout=subprocess.DEVNULL)
    words = ["up", "--controller", f"forte://{address}", "--pace", "lockstep", "--duration", "30", "--seed", "1"]
    command = [sys.executable, "-m", "dtwin", *words, "--log", str(log), "--json"]
    try:
        deadline = time.monotonic() + 10
        while (done := subprocess.run(command, cwd=ROOT, capture_output=True, timeout=90)).returncode:
            assert "cannot connect" in done.stderr.decode()
            assert time.monotonic() < deadline, "FORTE does not listen"
    finally:
        forte.kill()
        forte.wait()
    cell = Cell(CellSettings(30.0, 1))
    cell.run()
    expected, found = cell.log.freeze(), read_log(log)
    assert found.events == expected.events
    np.testing.assert_allclose(found.stack("volts"), expected.stack("volts"), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.stack("target"), expected.stack("target"), rtol=0, atol=1e-9)
