"""The controller's ports in a cell that is up: for its user alone, as the bus is for holders of certificates."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dtwin.controller.application import TIMEOUT
from dtwin.parameters import ROOT
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions
from dtwin.run.settings import CellSettings
from dtwin.services import runfile
from tests.support.desk import Desk
from tests.support.devices import DeployedApplication, embedded
from tests.support.logs import difference
from tests.support.ports import listening
from tests.support.waiting import until

needs_certificates = pytest.mark.skipif(
    shutil.which("openssl") is None, reason="needs the openssl command: install it"
)
NOBODY = 65534
KNOCK = """
import os, socket, sys
user, *addresses = sys.argv[1:]
if int(user) != os.getuid():
    os.setgroups([])
    os.setgid(int(user))
    os.setuid(int(user))
for address in addresses:
    kind, _, where = address.partition(":")
    sock = socket.socket(socket.AF_UNIX if kind == "unix" else socket.AF_INET)
    try:
        sock.connect(where if kind == "unix" else ("127.0.0.1", int(where)))
        print("connected")
    except OSError as error:
        print(type(error).__name__)
"""
"""Connects to every address as the user with a number, and tells what came of it."""


def knock(user: int, addresses: list[str]) -> list[str]:
    command = [sys.executable, "-c", KNOCK, str(user), *addresses]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.split()


@needs_certificates
def test_a_secured_cell_logs_what_a_headless_run_logs(desk: Desk, secured: Path, tmp_path: Path) -> None:
    log, headless = tmp_path / "secured.parquet", tmp_path / "headless.parquet"
    options = ["--zenoh", str(secured), "--pace", "lockstep", "--duration", "13", "--seed", "5"]
    desk.up(*options, "--log", str(log))
    cell = Cell(CellSettings(13, 5, control=ControlOptions().control()))
    cell.run()
    cell.log.freeze().write_parquet(headless)
    assert difference(log, headless) == ""
    assert list((desk.folder / "dtwin").iterdir()) == []


def test_a_controller_that_is_slow_in_lockstep_leaves_the_same_log(desk: Desk, tmp_path: Path) -> None:
    log, headless = tmp_path / "slow.parquet", tmp_path / "headless.parquet"
    desk.detach("--pace", "lockstep", "--duration", "13", "--seed", "5", "--log", str(log))
    until(lambda: desk.tick() > 100, "the arm moves")
    controller = desk.find("dtwin.services.controller")
    os.kill(controller, signal.SIGSTOP)
    frozen = time.monotonic()
    until(
        lambda: time.monotonic() > frozen + 1.5 * TIMEOUT, "an answer is later than would be waited for in real time"
    )
    os.kill(controller, signal.SIGCONT)
    until(lambda: log.exists(), "the run is over", 60.0)
    cell = Cell(CellSettings(13, 5, control=ControlOptions().control()))
    cell.run()
    cell.log.freeze().write_parquet(headless)
    assert difference(log, headless) == ""


@needs_certificates
@pytest.mark.skipif(os.getuid() != 0, reason="needs root to become another user")
def test_another_user_reaches_no_port_of_the_controller_in_a_secured_cell(desk: Desk, secured: Path) -> None:
    desk.detach("--zenoh", str(secured), "--pace", "lockstep")
    ports = listening(desk.find("dtwin.services.controller"))
    names = [port.removeprefix(f"unix:{desk.folder}/dtwin/cell.ports/") for port in ports]
    assert names == ["61499", "61500", "61501", "61502", "61503", "61504", "61505", "61506"]
    for folder in (desk.folder, desk.folder / "dtwin"):
        folder.chmod(0o755)  # so that the folder of the ports alone keeps them out
    assert knock(NOBODY, ports) == ["PermissionError"] * 8
    assert knock(os.getuid(), ports) == ["connected"] * 8
    (desk.folder / "dtwin" / "cell.ports").chmod(0o755)
    assert knock(NOBODY, ports) == ["PermissionError"] * 8, "the mode of the sockets keeps them out, too"
    assert "is down" in desk.run("down")


def test_a_cell_tells_its_user_where_its_controller_is(desk: Desk) -> None:
    said = desk.detach("--pace", "lockstep")
    address = runfile.require("cell").controller
    assert address == f"unix:{desk.folder}/dtwin/cell.ports/61499"
    assert f"device management is at {address}\n" in said
    assert f"controller: {address}\n" in desk.run("status")
    assert desk.run("fb", "watch", address, "CELL.PLANNER.T", "--count", "1") == "CELL.PLANNER.T\n2.0\n"
    os.kill(desk.find("dtwin.services.controller"), signal.SIGKILL)
    until(lambda: desk.summary()["services"]["controller"]["restarts"] == 1, "the controller is started again")
    ticks = desk.tick()
    until(lambda: desk.tick() > ticks + 200, "the cell goes on at the ports that were left behind", 60.0)
    assert "is down" in desk.run("down")


def test_a_recorder_that_is_slow_in_lockstep_gets_the_whole_run(desk: Desk, tmp_path: Path) -> None:
    """What it had not read yet when the emulator left was lost."""
    log, headless = tmp_path / "slow.parquet", tmp_path / "headless.parquet"
    desk.detach("--pace", "lockstep", "--duration", "13", "--seed", "5", "--log", str(log))
    recorder = desk.find("dtwin.services.recorder")
    os.kill(recorder, signal.SIGSTOP)
    until(lambda: desk.summary()["services"]["emulator"]["state"] == "stopping", "the emulator has done all ticks")
    os.kill(recorder, signal.SIGCONT)
    until(lambda: log.exists(), "the log is there", 60.0)
    cell = Cell(CellSettings(13, 5, control=ControlOptions().control()))
    cell.run()
    cell.log.freeze().write_parquet(headless)
    assert difference(log, headless) == ""


def test_a_path_too_long_for_sockets_is_one_line(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    deep = desk.folder / ("x" * 100)
    deep.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(deep))
    said = desk.run("up", status=2)
    assert "expected at most 107 for a socket" in said
    assert len(said.strip().splitlines()) == 1


@needs_certificates
def test_open_ports_of_another_device_are_told(desk: Desk, secured: Path) -> None:
    with embedded() as device:
        application = DeployedApplication(device)
        application.deploy()
        application.client.close()
        options = ["--controller", f"tcp://{device}", "--pace", "lockstep"]
        command = [sys.executable, "-m", "dtwin", "up", *options, "--duration", "1", "--zenoh", str(secured)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=90)
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith(f"dtwin: warning: the ports of {device} ask for no certificate")
