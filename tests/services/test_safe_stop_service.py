"""The safe stop over the bus: a fault stops the arm in the blocks, and a release lets it sort on."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator

import numpy as np
import pytest

from dtwin.bus.messages import (
    EVENTS,
    FAULT,
    LATCH,
    MONITORING,
    RESIDUALS,
    SENSORS,
    STOP,
    Done,
    FaultRequest,
    LatchRequest,
    LatchState,
    StopRequest,
    StopState,
)
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import MonitoringResiduals, MonitoringVerdict
from dtwin.errors import CommunicationError
from dtwin.monitoring.verdict import Finding
from dtwin.services.parts.stopping.demands import Demands, Failure
from dtwin.services.runfile import join
from dtwin.signals import Event, Sensors
from tests.support.bus import noting
from tests.support.desk import Desk, boxes, new_desk
from tests.support.ports import free_port
from tests.support.waiting import until

FOUND = Finding("K2", "voltage constant", 2, -0.9, 0.01, 0.9995, 45.0, 45.1, True)
WEAKENED, REPAIRED = "K1*=0.75@0", "K1*=1.3333333333333333@0"
"""A loss that the controller makes up for; at 0.65 it would stop the arm itself, perhaps before the monitor does."""
FROZEN = Finding("freeze1", "encoder freeze", 1, 0.0, 0.0, 1.0, 46.0, 46.1, True)


class Watch:
    """What passes on the bus."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.events: list[Event] = []
        self.time = 0.0
        bus.subscribe(EVENTS, Event, self.events.append)
        bus.subscribe(SENSORS, Sensors, lambda sensors: setattr(self, "time", sensors.time))

    def stop(self) -> str:
        return self.bus.ask(STOP, None, StopState).stop

    def stands(self) -> bool:
        """Whether the arm is stopped and does not brake any more; the bridge may be looking for its controller."""
        try:
            return self.stop() in ("standstill", "torque off")
        except CommunicationError:
            return False

    def said(self) -> str:
        """The first thing that the monitor said about a stop."""
        return self.texts("monitor_stop")[0]

    def texts(self, kind: str) -> list[str]:
        return [event.text for event in self.events if event.kind == kind]


def test_a_fault_stops_the_arm_until_an_operator_releases_it(desk: Desk) -> None:
    # In lockstep nobody waits for the monitor, which on a busy machine falls behind: that is silence, too.
    patient = ("--silence", "120")
    desk.detach("--pace", "lockstep", "--monitoring", "--safe-stop", *patient, "--noise", "0.003", "--seed", "3")
    with join("cell") as bus:
        watch = Watch(bus)
        verdicts: list[MonitoringVerdict] = []
        values: list[MonitoringResiduals] = []
        bus.subscribe(MONITORING, MonitoringVerdict, verdicts.append)
        bus.subscribe(RESIDUALS, MonitoringResiduals, values.append)
        until(lambda: len(verdicts) > 40, "watched work without a fault until the monitor knows the arm", 90.0)
        assert watch.stop() == "none", watch.texts("stop")
        heard = values[0].time + 2.0  # the cell waits for no monitor, which hears the noise first
        z = np.array([np.array(value.residual) / value.deviation for value in values if value.time > heard])
        assert len(z) > 20
        assert 0.5 < np.mean(z**2) < 2.0
        began = bus.ask(FAULT, FaultRequest((WEAKENED,)), Done).time
        until(lambda: watch.texts("monitor_stop"), "the monitor asks for a stop")
        # in lockstep nobody waits for the monitor: what it misses on a busy machine may spoil the cause that it names
        assert re.fullmatch(r"asked for a safe stop \(.*\): the blocks answer (braking|torque off)", watch.said())
        until(watch.stands, "the arm stands or has no torque")
        until(lambda: watch.texts("stop")[-1].startswith(f"safe stop: {watch.stop()}"), "the change is told")
        assert "(monitoring: " in watch.texts("stop")[0]
        assert min(event.time for event in watch.events if event.kind in ("stop", "monitor_stop")) > began
        until(lambda: desk.summary()["services"]["bridge"]["state"] == "stopped", "the status says so")
        kill_controller(desk, watch)
        stood, reached = boxes(desk).delivered, watch.time
        until(lambda: watch.time > reached + 16.0, "the cell goes on")
        assert boxes(desk).delivered == stood
        bus.ask(FAULT, FaultRequest((REPAIRED,)), Done)
        assert desk.run("release", "--why", "repaired", "--who", "anna") == "none: the arm moves\n"
        until(lambda: "safe stop: released (anna: repaired)" in watch.texts("stop"), "the release is told")
        until(lambda: sorts_on(desk, watch, stood), "the arm sorts on")
    desk.run("down")


def sorts_on(desk: Desk, watch: Watch, delivered: int) -> bool:
    """Whether so many boxes are delivered; the monitor may first take the repaired arm for another failure."""
    if watch.stands():
        desk.run("release")
    return boxes(desk).delivered > delivered


def kill_controller(desk: Desk, watch: Watch) -> None:
    """It comes back stopped: nobody has released the arm. It may hang so that it is held."""
    os.kill(desk.find("dtwin.services.controller"), signal.SIGKILL)
    until(lambda: desk.summary()["services"]["controller"]["restarts"] == 1, "the controller is back")
    reached = watch.time
    until(lambda: watch.time > reached + 5.0, "the cell goes on")
    until(watch.stands, "the new one stops the arm")


def test_a_safe_stop_needs_the_monitor(desk: Desk) -> None:
    assert "expected --monitoring" in desk.run("up", "--safe-stop", status=2)


def test_a_record_of_the_arm_needs_the_monitor(desk: Desk) -> None:
    assert "--commissioned: expected --monitoring" in desk.run("up", "--commissioned", "arm.json", status=2)


@pytest.fixture(scope="module")
def started() -> Iterator[Desk]:
    """A cell shared by those who leave it running, since starting it takes longer than what they do."""
    with new_desk() as desk:
        desk.detach("--pace", "lockstep", "--seed", "3")
        yield desk
        desk.run("down")


def test_an_arm_that_has_diverged_begins_anew_without_torque_until_it_is_released(started: Desk) -> None:
    with join("cell") as bus:
        watch = Watch(bus)
        until(lambda: watch.time > 1.0, "the arm moves")
        # What is turned from outside diverges also when the blocks have cut off the voltage.
        bus.ask(FAULT, FaultRequest(("push2+=1e6@0",)), Done)
        until(lambda: watch.texts("diverged"), "the divergence is told")
        until(lambda: watch.stop() == "torque off", "the bridge knows of the stop")
        assert started.run("release", "--why", "another arm", "--who", "anna") == "none: the arm moves\n"
        until(lambda: boxes(started).delivered > 0, "the arm sorts")
        assert len(watch.texts("diverged")) == 1
    assert started.summary()["services"]["emulator"]["restarts"] == 0


def test_an_operator_stops_and_releases_the_arm(started: Desk) -> None:
    with join("cell") as bus:
        watch = Watch(bus)
        until(lambda: watch.time > 10.0, "some work")
        answer = bus.ask(STOP, StopRequest("anna", "not sure", confidence=0.9), StopState)
        assert answer.stop == "none"
        assert "is held where it is" in started.run("stop", "--who", "anna", "--why", "look at it")
        assert watch.stop() == "standstill"
        assert watch.texts("stop")[0] == "safe stop: braking (anna: look at it)"
        assert "is held where it is" in started.run("stop")
        stood = boxes(started).delivered
        assert started.run("release") == "none: the arm moves\n"
        assert started.run("release") == "none: the arm moves\n"
        until(lambda: boxes(started).delivered > stood, "the arm sorts on")


def test_a_demand_is_made_until_it_is_answered_once() -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    asked: list[StopRequest | None] = []
    events: list[Event] = []
    with Bus(open_peer(meet)) as monitor, Bus(open_peer(meet)) as bridge:
        bridge.subscribe(EVENTS, Event, events.append)
        demands = Demands(monitor)
        demands.stand(frozenset({"K2", "freeze1"}))
        demands.failed(Failure.of(FOUND))
        bridge.answer(STOP, StopRequest, noting(asked, StopState(45.3, "braking")))
        until(lambda: asked, "the demand is made")
        demands.failed(Failure.of(FROZEN))
        until(lambda: len(events) == 2, "both answers are told")
    assert [(request.state, request.confidence) for request in asked if request] == [
        ("failed", 1.0),
        ("angles unknown", 1.0),
    ]
    assert {(event.kind, event.time) for event in events} == {("monitor_stop", 45.3)}


def test_no_demand_is_made_for_a_failure_that_is_over() -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    asked: list[StopRequest | None] = []
    with Bus(open_peer(meet)) as monitor, Bus(open_peer(meet)) as bridge:
        demands = Demands(monitor)
        demands.stand(frozenset({"freeze1"}))
        demands.failed(Failure.of(FOUND))
        demands.failed(Failure.of(FROZEN))
        bridge.answer(STOP, StopRequest, noting(asked, StopState(46.3, "torque off")))
        until(lambda: asked, "the demand is made")
    assert [request.state for request in asked if request] == ["angles unknown"]


def test_the_torque_is_taken_off_when_the_blocks_do_not_answer_for_too_long() -> None:
    meet = f"tcp/127.0.0.1:{free_port()}"
    asked: list[LatchRequest | None] = []
    events: list[Event] = []
    with Bus(open_peer(meet)) as monitor, Bus(open_peer(meet)) as emulator:
        emulator.subscribe(EVENTS, Event, events.append)
        emulator.answer(LATCH, LatchRequest, noting(asked, LatchState(47.1, 1, "torque off")))
        demands = Demands(monitor, patience=0.0)
        demands.stand(frozenset({"K2"}))
        demands.failed(Failure.of(FOUND))
        until(lambda: events, "the second way is told")
    assert [request.stop for request in asked if request] == ["torque off"]
    assert (events[0].kind, events[0].time) == ("monitor_stop", 47.1)
    assert "the emulator answers torque off" in events[0].text
