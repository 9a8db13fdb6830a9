"""The monitoring service watches a running cell."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dtwin.commands.up import join
from dtwin.messages import (
    EVENTS,
    FAULT,
    MONITORING,
    RESIDUALS,
    Done,
    FaultRequest,
    MonitoringResiduals,
    MonitoringVerdict,
)
from dtwin.monitoring.belief import assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.parameters import ArmParameters
from dtwin.signals import Event
from services.monitoring import residuals, verdict_message
from tests.services.bench import until
from tests.services.test_up import Desk


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Iterator[Desk]:
    folder = tmp_path / "runtime"
    folder.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    desk = Desk(folder, capsys)
    yield desk
    desk.run("down")
    for pid in desk.processes():
        os.kill(pid, signal.SIGKILL)


def test_a_fault_of_the_running_cell_is_published(desk: Desk) -> None:
    desk.up("--detach", "--pace", "lockstep", "--monitoring", "--noise", "0.003", "--seed", "3")
    verdicts: list[MonitoringVerdict] = []
    values: list[MonitoringResiduals] = []
    events: list[Event] = []
    with join("cell") as bus:
        bus.subscribe(MONITORING, MonitoringVerdict, verdicts.append)
        bus.subscribe(RESIDUALS, MonitoringResiduals, values.append)
        bus.subscribe(EVENTS, Event, events.append)
        until(lambda: verdicts and verdicts[-1].time > 10.0, "a verdict on some seconds of work")
        assert {unit.state for unit in verdicts[-1].units.values()} == {"nominal"}
        bus.ask(FAULT, FaultRequest(("K1*=0.6@0",)), Done)
        until(lambda: any(v.units["joint 1"].cause == "voltage constant" for v in verdicts), "the cause is named")
        found = next(v.units["joint 1"] for v in verdicts if v.units["joint 1"].cause == "voltage constant")
        assert found.state == "failed"
        assert found.parameter == "K1"
        assert found.size == pytest.approx(-0.4, abs=0.1)
        until(lambda: any(event.kind == "monitor_failed" for event in events), "the event is published")
        quiet = [v for v in values if v.time > 2.0 and v.evidence < v.threshold]
        assert len(quiet) > 10
        z = np.array([np.array(v.residual) / v.deviation for v in quiet])
        assert 0.5 < np.mean(z**2) < 2.0
        os.kill(desk.find("services.monitoring"), signal.SIGKILL)
        seen = len(verdicts)
        until(lambda: len(verdicts) > seen + 2, "the service is back and goes on")
        assert verdicts[-1].missed >= 0


def test_a_nominal_verdict_as_it_is_published() -> None:
    monitor = Monitor(assumed(ArmParameters(), (1e-3, 1e-3, 1e-3)))
    monitor.update(0, np.zeros(3), np.zeros(3), False)
    message = verdict_message(monitor.verdict(), monitor.restarts)
    assert list(message.units) == ["joint 1", "joint 2", "joint 3", "gripper"]
    assert all(unit.cause == "" for unit in message.units.values())
    assert residuals(0, monitor).deviation[0] > 0.0
