"""`dtwin fb run`, `watch` and `stop`: a device as a process of its own, and the cell controlled by it."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from dtwin.cli import main
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.remote import RemoteController
from dtwin.parameters import ROOT
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from iec61499.net.address import Address, parse_address
from tests.support.driven import DEPLOYED

PATIENCE = 20.0


@pytest.fixture
def system(tmp_path: Path) -> Path:
    """The cell's system on ports the operating system chooses."""
    copy = tmp_path / "cell.sys"
    copy.write_text(re.sub(r"localhost:615\d\d", "localhost:0", (ROOT / "fb" / "dtwin.sys").read_text()))
    return copy


@contextmanager
def device(*arguments: str | Path) -> Iterator[tuple[subprocess.Popen[str], dict[str, Address]]]:
    """`dtwin fb run` and where it listens, by block name and "management"."""
    command = [sys.executable, "-m", "dtwin", "fb", "run", "--listen", "127.0.0.1:0", *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout is not None
    addresses = {}
    try:
        while not (line := process.stdout.readline()).startswith("running"):
            assert line, "the device has ended"
            name, _, address = line.strip().partition(" on ")
            addresses[name] = parse_address(address)
        yield process, addresses
    finally:
        process.kill()
        process.wait(PATIENCE)
        process.stdout.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_device_ends_cleanly_on_a_signal(number: signal.Signals) -> None:
    with device() as (process, addresses):
        assert list(addresses) == ["management"]
        process.send_signal(number)
        assert process.wait(PATIENCE) == 0


def test_watch_and_stop(system: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with device(system, "--blocks", ROOT / "fb") as (_, addresses):
        management = str(addresses["management"])
        names = ["CELL.EMULATOR.STATUS", "EMB_RES.CELL.PLANNER.T"]
        assert main(["fb", "watch", management, *names, "--count", "2", "--interval", "0.001"]) == 0
        assert capsys.readouterr().out == "CELL.EMULATOR.STATUS\tEMB_RES.CELL.PLANNER.T\nOK\t2.0\nOK\t2.0\n"
        assert main(["fb", "watch", management, "CELL.PLANNER.NOTHING"]) == 2
        assert "CELL.PLANNER.NOTHING: no such block or port" in capsys.readouterr().err
        assert main(["fb", "watch", management, "PLANNER.T"]) == 2
        assert "PLANNER.T: no such block or port: expected CELL.PLANNER.T\n" in capsys.readouterr().err
        assert main(["fb", "stop", management]) == 0
        assert capsys.readouterr().out == "EMB_RES stopped\n"
        assert main(["fb", "stop", management]) == 0
        assert capsys.readouterr().out == "EMB_RES does not stop: INVALID_STATE\n"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["run", "missing.sys"], "missing.sys: cannot be read"),
        (["run", "fb/README.md"], "expected a system (.sys) or a boot file (.fboot)"),
        (["run", "--listen", "host.example:1"], "expected localhost or a numeric IPv4 host"),
        (["stop", "127.0.0.1:1"], "127.0.0.1:1: cannot connect"),
        (["watch", "127.0.0.1:1", "A.B", "--interval", "0"], "--interval: expected at least 0.001 s, got 0.0"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    assert main(["fb", *arguments]) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1


def test_a_run_controlled_over_tcp_is_bit_identical(system: Path, tmp_path: Path) -> None:
    settings = CellSettings(duration=40.0, seed=1, control=DEPLOYED)
    embedded = Cell(settings)
    embedded.run()
    with (
        device(system, "--blocks", ROOT / "fb") as (_, addresses),
        RemoteController(addresses["CELL.EMULATOR"], EmbeddedController(settings.control)) as controller,
    ):
        remote = Cell(settings, controller)
        remote.run()
        assert controller.largest_difference == 0.0
    logs = []
    for name, cell in (("remote", remote), ("embedded", embedded)):
        cell.log.freeze().write_parquet(tmp_path / name)
        logs.append((tmp_path / name).read_bytes())
    assert logs[0] == logs[1]
