"""The monitoring service watches a running cell."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest

from dtwin.bus.messages import EVENTS, FAULT, MONITORING, RESIDUALS, Done, FaultRequest
from dtwin.bus.twin_messages import MonitoredUnit, MonitoringResiduals, MonitoringVerdict
from dtwin.monitoring.estimation.belief import assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.parameters import ArmParameters
from dtwin.services.monitoring import residuals
from dtwin.services.runfile import join
from dtwin.signals import Event
from tests.support.desk import Desk
from tests.support.waiting import until


@pytest.mark.thorough
def test_a_fault_of_the_running_cell_is_published(desk: Desk) -> None:
    """In usual runs test_tutorial.py finds a fault with its cause and acknowledges it, test_safe_stop_service.py
    hears verdicts, residuals and the event of another, and tests/monitoring/test_findings.py acknowledges and sizes.
    """
    desk.detach("--pace", "lockstep", "--monitoring", "--noise", "0.003", "--seed", "3")
    verdicts: list[MonitoringVerdict] = []
    values: list[MonitoringResiduals] = []
    events: list[Event] = []
    with join("cell") as bus:
        bus.subscribe(MONITORING, MonitoringVerdict, verdicts.append)
        bus.subscribe(RESIDUALS, MonitoringResiduals, values.append)
        bus.subscribe(EVENTS, Event, events.append)
        until(lambda: len(verdicts) > 40 and len(values) > 40, "verdicts until the monitor knows the arm", 90.0)
        assert {unit.state for unit in verdicts[-1].units.values()} == {"nominal"}
        began = bus.ask(FAULT, FaultRequest(("K1*=0.6@0",)), Done).time

        def named() -> list[MonitoredUnit]:
            units = [verdict.units["joint 1"] for verdict in verdicts]
            return [unit for unit in units if unit.parameter == "K1" and unit.deviation < 0.02]

        until(named, "the cause is named and sized")
        found = named()[0]
        assert found.state == "failed"
        assert found.cause == "voltage constant"
        assert found.size == pytest.approx(-0.4, abs=0.08)
        until(lambda: any(event.kind == "monitor_failed" for event in events), "the event is published")
        heard = values[0].time + 2.0  # The cell waits for no monitor, which hears the noise first.
        healthy = [v for v in values if heard < v.time < began]
        assert len(healthy) > 20
        z = np.array([np.array(v.residual) / v.deviation for v in healthy])
        assert 0.5 < np.mean(z**2) < 2.0
        assert max(v.evidence / v.threshold for v in healthy) < 1.0
        assert "'D3': expected K1" in desk.run("monitor", "acknowledge", "D3", status=2)
        assert "joint 1   nominal" in desk.run("monitor", "acknowledge", "K1")
        until(lambda: any(event.kind == "monitor_acknowledged" for event in events), "so is that it is known")
        seen = len(verdicts)
        until(lambda: len(verdicts) > seen + 3, "it stays known")
        assert {verdict.units["joint 1"].state for verdict in verdicts[seen:]} == {"nominal"}
        assert "no finding 'K1'" in desk.run("monitor", "acknowledge", "K1", status=2)
        os.kill(desk.find("dtwin.services.monitoring"), signal.SIGKILL)
        seen = len(verdicts)
        until(lambda: len(verdicts) > seen + 2, "the service is back and goes on")
        assert verdicts[-1].missed >= 0


def test_a_nominal_verdict_as_it_is_published() -> None:
    monitor = Monitor(assumed(ArmParameters(), (1e-3, 1e-3, 1e-3)))
    monitor.update(0, np.zeros(3), np.zeros(4), False)
    message = monitor.verdict()
    assert list(message.units) == ["joint 1", "joint 2", "joint 3", "gripper"]
    assert all(unit.cause == "" for unit in message.units.values())
    assert residuals(0, (0.0, 0.0, 0.0), monitor).deviation[0] > 0.0
