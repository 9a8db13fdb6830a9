"""`dtwin up`, `status`, `down`, `watch` and the setting commands, as a user runs them."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import pytest

from dtwin.logs.reading import read_log
from dtwin.parameters import ROOT
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions, PlantOptions
from dtwin.signals import BoxCounts
from tests.support.desk import Desk, boxes
from tests.support.logs import difference
from tests.support.ports import free_port
from tests.support.waiting import until

DURATION = 13


def test_lockstep_over_zenoh_logs_what_a_headless_run_logs(desk: Desk, tmp_path: Path) -> None:
    log, headless = tmp_path / "zenoh.parquet", tmp_path / "headless.parquet"
    options = ["--seed", "5", "--noise", "0.003", "--fault", "D1*=1.5@9", "--cell-file", "four-colours"]
    said = desk.up("--pace", "lockstep", "--duration", str(DURATION), *options, "--log", str(log), "--json")
    summary = json.loads(said)
    plant = PlantOptions(seed=5, noise=0.003, fault=("D1*=1.5@9",), cell_file="four-colours")
    control = ControlOptions(cell_file="four-colours").control()
    cell = Cell(replace(plant.settings(), duration=DURATION, control=control))
    cell.run()
    cell.log.freeze().write_parquet(headless)
    assert difference(log, headless) == ""
    assert summary["ticks"] == 100 * DURATION
    assert {name: service["restarts"] for name, service in summary["services"].items()} == dict.fromkeys(
        ("controller", "recorder", "bridge", "emulator"), 0
    )
    assert msgspec.convert(summary["boxes"], BoxCounts) == cell.emulation.box_counts
    assert not desk.processes()
    assert list((desk.folder / "dtwin").iterdir()) == []


def test_a_cell_is_started_watched_set_and_stopped(desk: Desk, tmp_path: Path) -> None:
    recording = tmp_path / "run.rrd"
    desk.up("--detach", "--record", str(recording))
    assert "is up already" in desk.up(status=2)
    assert "is up already" in desk.up("--detach", status=2)
    until(lambda: desk.summary()["ticks"] > 100, "the cell runs in real time")
    lines = [desk.processes()[desk.find(f"services.{name}")] for name in ("emulator", "bridge", "controller")]
    assert all("--urgent" in line for line in lines), "no sample waits for a busy processor on its way"
    summary = json.loads(desk.run("status", "--json"))
    assert summary.keys() == desk.summary().keys()
    assert {service["state"] for service in summary["services"].values()} == {"running"}
    assert summary["latency_ms"]["p50"] < 10
    lines = desk.run("watch", "--count", "6", "--json").splitlines()
    assert all(line.startswith("dtwin/cell/arm/") and '"schema":1' in line for line in lines)
    lines = desk.run("watch", "sensors", "--count", "2").splitlines()
    assert all(re.match(r"dtwin/cell/arm/sensors sequence=\d+ time=[\d.]+ theta=\(", line) for line in lines)
    assert "dtwin up --simulation" in desk.run("target", "set", "--time", "1.5", status=2)
    assert "is down" in desk.run("down")
    until(lambda: not desk.processes(), "all processes end")
    assert recording.stat().st_size > 100_000
    assert "not up" in desk.run("status", status=2)


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="this system does not choose processors")
@pytest.mark.parametrize("pace", ["realtime", "lockstep"])
def test_services_that_take_turns_share_a_processor(desk: Desk, pace: str) -> None:
    desk.up("--detach", "--pace", pace)
    allowed = [os.sched_getaffinity(desk.find(f"services.{name}")) for name in ("emulator", "bridge", "controller")]
    assert len(allowed[0]) == 1
    assert allowed.count(allowed[0]) == 3
    desk.run("down")


def test_a_plain_program_joins_and_so_does_a_second_terminal(desk: Desk, tmp_path: Path) -> None:
    """The program in Python of docs/clients.md, and commands with the configuration that `up` was given."""
    program = re.search(r"```python\n(.*?)```", (ROOT / "docs" / "clients.md").read_text(), re.DOTALL)
    assert program is not None
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    for file in (ROOT / "config" / "single").iterdir():
        (tmp_path / file.name).write_text(file.read_text().replace("tcp/127.0.0.1:7461", endpoint))
    said = desk.detach("--zenoh", str(tmp_path))
    assert f"the configuration in {tmp_path}" in said
    command = [sys.executable, "-c", program[1], endpoint]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert len(done.stdout.splitlines()) == 100, done.stderr
    assert "sensors" in desk.run("watch", "sensors", "--count", "1", "--zenoh", str(tmp_path))
    desk.run("down")
    said = desk.detach()
    endpoint = said.partition("connects to ")[2].partition(",")[0]
    done = subprocess.run([*command[:3], endpoint], capture_output=True, text=True, timeout=60)
    assert len(done.stdout.splitlines()) == 100, done.stderr
    desk.run("down")


def kill_and_wait(desk: Desk, name: str, number: signal.Signals = signal.SIGKILL) -> int:
    """Kills a service, waits until it is back and the cell goes on, and returns the tick of the kill."""
    restarts = desk.summary()["services"][name]["restarts"]
    tick = desk.tick()
    os.kill(desk.find(f"services.{name}"), number)
    back = {"restarts": restarts + 1, "state": "running"}.items()
    until(lambda: back <= desk.summary()["services"][name].items(), f"{name} is back")
    until(lambda: desk.tick() > tick + 200, f"the cell goes on after {name}")
    return tick


def test_killed_services_come_back_and_end_with_their_supervisor(desk: Desk, tmp_path: Path) -> None:
    """Killed services come back, and so does an emulator that is asked to end."""
    log = tmp_path / "run.parquet"
    desk.detach("--pace", "lockstep", "--log", str(log))
    for name in ("bridge", "emulator", "controller", "recorder"):
        counted = boxes(desk)
        before = kill_and_wait(desk, name)
        assert boxes(desk).arrived >= counted.arrived
    counted = boxes(desk)
    assert counted.picked - counted.delivered - counted.misplaced == counted.held
    if sys.platform == "linux":  # What was forked outlives who has forked it, and what comes next is started anew.
        forked = desk.find("dtwin.services.bridge")
        os.kill(desk.find("processes.fork_server"), signal.SIGKILL)
        kill_and_wait(desk, "recorder")
        assert desk.find("dtwin.services.bridge") == forked
    before = kill_and_wait(desk, "emulator", signal.SIGTERM)
    parts = tmp_path / "run.parquet.parts"
    first = until(lambda: min(parts.glob("[0-9]*.parquet"), default=None), "the first part of the log is kept")
    assert len(read_log(first)) > 0
    os.kill(desk.find("dtwin up"), signal.SIGKILL)
    until(lambda: not desk.processes(), "no process outlives its supervisor")
    times = read_log(log).columns["t"]
    assert times[0] == 0.0
    assert times[-1] > 0.01 * before, "the recorder that came back went on with the log of the killed one"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_cell_that_finds_no_router(desk: Desk, tmp_path: Path, number: signal.Signals) -> None:
    text = (ROOT / "config" / "routed" / "service.json5").read_text()
    (tmp_path / "service.json5").write_text(text.replace("7447", str(free_port())))
    command = [sys.executable, "-m", "dtwin", "up", "--zenoh", str(tmp_path)]
    # A shell's background job ignores SIGINT, and so would what it starts.
    heed = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True, preexec_fn=heed)
    assert process.stderr is not None
    with process.stderr as said:
        assert "cannot join yet" in said.readline()
        process.send_signal(number)
        assert process.wait(20.0) in (-number, 128 + number)
        assert "Traceback" not in said.read()
    assert not desk.processes()
    assert "not up" in desk.run("status", status=2)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--controller", "nonsense"], "expected embedded, forte://HOST:PORT or tcp://HOST:PORT"),
        (["--duration", "0"], "duration"),
        (["--log", "/nowhere/run.parquet"], "/nowhere/run.parquet"),
        (["--mjcf", "nowhere.xml"], "nowhere.xml"),
        (["--seed", "-1"], "seed: expected a whole number"),
        (["--noise", "-1"], "noise: expected a finite magnitude"),
        (["--step", "0.003"], "step"),
        (["--arm", "six-axis", "--noise", "0.01"], "--noise: has no meaning for another arm than the thesis's"),
        (
            ["--arm", "six-axis", "--machine", "old"],
            "machine 'old': expected ideal, nominal, a number up to 1000000000",
        ),
        (["--arm", "missing.urdf"], "missing.urdf: cannot be read"),
        (["--late", "1"], "expected --arm with another arm"),
    ],
)
def test_bad_options_are_one_line(desk: Desk, options: list[str], expected: str) -> None:
    ends = [] if "--duration" in options else ["--duration", "1"]  # so that what is accepted fails at once
    said = desk.run("up", *options, *ends, status=2)
    assert expected in said
    assert len(said.strip().splitlines()) == 1
    assert not desk.processes()
