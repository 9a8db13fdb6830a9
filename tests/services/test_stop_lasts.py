"""A stop lasts until its release, whatever is killed meanwhile: what the arm obeyed, and what is read of the stop."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import numpy as np
import pytest

from dtwin.bus.messages import (
    ACTED,
    EVENTS,
    RELEASE,
    RESET,
    SENSORS,
    STOP,
    VOLTAGES,
    Acted,
    Done,
    ReleaseRequest,
    ResetRequest,
    StopRequest,
    StopState,
)
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError
from dtwin.signals import STOPS, ArmState, Event, Quad, Sensors, Voltages
from services.runfile import join
from tests.support.desk import Desk, new_desk
from tests.support.waiting import until

PATIENCE = 60.0
"""Deadline of every wait, s."""
DEMANDS: dict[str, ArmState] = {"standstill": "failed", "torque off": "angles unknown"}
ORDERS = (
    ("controller",),
    ("bridge",),
    ("emulator",),
    ("controller", "bridge"),
    ("bridge", "emulator"),
    ("controller", "emulator"),
    ("controller", "bridge", "emulator"),
)


class Watch:
    """A cell that is up, seen from outside."""

    def __init__(self, bus: Bus, desk: Desk) -> None:
        self.bus = bus
        self.desk = desk
        self.samples: dict[int, Sensors] = {}
        self.commands: dict[int, Quad] = {}
        self.acted: dict[int, Quad] = {}
        self.tick = 0
        self.events: list[Event] = []
        self.read: list[str] = []
        bus.subscribe(SENSORS, Sensors, self._take)
        bus.subscribe(EVENTS, Event, self.events.append)
        bus.subscribe(VOLTAGES, Voltages, lambda command: self.commands.setdefault(command.sequence, command.volts))
        bus.subscribe(ACTED, Acted, lambda acted: self.acted.update({acted.sequence: acted.volts}))

    def _take(self, sensors: Sensors) -> None:
        if sensors.sequence < self.tick - 100:  # The cell has been reset.
            self.samples.clear()
            self.commands.clear()
            self.acted.clear()
        self.samples[sensors.sequence] = sensors
        self.tick = sensors.sequence

    def stop(self) -> str:
        """The stop that is read, or "" while there is nobody to answer."""
        try:
            found = self.bus.ask(STOP, None, StopState, 1.0).stop
        except CommunicationError:
            return ""
        self.read.append(found)
        return found

    def goes_on(self, ticks: int) -> None:
        """Waits for so many ticks."""
        reached = self.tick
        until(lambda: self.tick > reached + ticks, "the cell goes on", PATIENCE)

    def demand(self, stop: str) -> None:
        """Stops the arm."""
        self.bus.ask(STOP, StopRequest("anna", "look at it", DEMANDS[stop]), StopState)
        until(lambda: self.stop() == stop, f"the arm has its {stop}", PATIENCE)
        self.read = [stop]

    def release(self) -> None:
        assert self.bus.ask(RELEASE, ReleaseRequest("anna", "done"), StopState).stop == "none"

    def obeyed(self) -> np.ndarray:
        """Volts that the arm obeyed, tick by tick, V: the command that answers the sample, if nothing else acted."""
        acted = {**self.commands, **self.acted}
        return np.array([acted.get(k, (0.0, 0.0, 0.0, 0.0)) for k in range(self.tick)])

    def kill(self, names: tuple[str, ...]) -> None:
        """Kills services at once and waits until all are back."""
        before = self.restarts(names)
        pids = [self.desk.find(f"services.{name}") for name in names]
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        until(lambda: self.restarts(names) == [n + 1 for n in before], "they start again", PATIENCE, self.stop)

    def restarts(self, names: tuple[str, ...]) -> list[int]:
        services = self.desk.summary()["services"]
        return [services[name]["restarts"] for name in names]


@pytest.fixture(scope="module", params=DEMANDS)
def stopped(request: pytest.FixtureRequest) -> Iterator[tuple[Watch, str]]:
    """A cell shared by the orders, since starting it takes longer than killing its services."""
    with new_desk() as desk:
        desk.up("--detach", "--pace", "lockstep", "--seed", "3")
        with join("cell") as bus:
            yield Watch(bus, desk), request.param
        desk.run("down")


@pytest.mark.parametrize("killed", ORDERS, ids="+".join)
def test_only_a_release_ends_a_stop(stopped: tuple[Watch, str], killed: tuple[str, ...]) -> None:
    watch, stop = stopped
    watch.goes_on(200)
    watch.demand(stop)
    watch.goes_on(20)
    off = watch.tick
    watch.kill(killed)
    until(lambda: watch.stop() == "torque off", "nobody knows any longer that the arm is held", PATIENCE)
    off = off if stop == "torque off" else watch.tick + 1
    watch.goes_on(300)
    assert watch.stop() == "torque off"
    ranks = [STOPS.index(found) for found in watch.read]
    assert ranks == sorted(ranks), "it never reads weaker than before"
    last = watch.tick
    obeyed = watch.obeyed()[off:last]
    moved = off + np.flatnonzero(obeyed.any(axis=1))
    assert not len(moved), [(k, watch.commands.get(k), watch.acted.get(k), watch.tick) for k in moved[:5].tolist()]
    watch.release()
    watch.goes_on(200)
    assert_no_jump(watch, last)


def assert_no_jump(watch: Watch, released: int) -> None:
    """Without a jump the voltages grow from what holds the arm where it is, and never by much in one tick."""
    volts = watch.obeyed()[released:, :3]
    first = int(np.flatnonzero(volts.any(axis=1))[0])
    assert np.abs(volts[first : first + 30]).max() < 5.0
    assert np.abs(np.diff(volts[first : first + 30], axis=0)).max() < 0.5
    theta = np.array([watch.samples[released + first + k].theta for k in range(30)])
    assert np.abs(np.diff(theta, axis=0)).max() < 0.03


def test_a_reset_ends_no_stop(stopped: tuple[Watch, str]) -> None:
    watch, stop = stopped
    watch.demand(stop)
    watch.bus.ask(RESET, ResetRequest(3), Done)
    until(lambda: watch.tick < 100, "the cell has started anew", PATIENCE)
    until(lambda: watch.stop() == "torque off", "another arm stands there now", PATIENCE)
    watch.goes_on(100)
    assert "none" not in watch.read
    assert not watch.obeyed()[: watch.tick].any()
    watch.release()
    watch.goes_on(100)


def test_a_release_that_the_emulator_does_not_hear_is_refused(stopped: tuple[Watch, str]) -> None:
    watch, stop = stopped
    watch.demand(stop)
    emulator = watch.desk.find("services.emulator")
    os.kill(emulator, signal.SIGSTOP)
    try:
        with pytest.raises(CommunicationError, match="not released, the torque is off"):
            watch.bus.ask(RELEASE, ReleaseRequest("anna", "done"), StopState, PATIENCE)
    finally:
        os.kill(emulator, signal.SIGCONT)
    off = watch.tick + 1
    until(lambda: watch.stop() == "torque off", "the blocks are stopped again", PATIENCE)
    watch.goes_on(100)
    assert watch.stop() == "torque off"
    assert not watch.obeyed()[off : watch.tick].any()
    watch.release()
    watch.goes_on(100)


def test_a_stop_outlives_the_supervisor_but_not_an_orderly_end() -> None:
    with new_desk() as desk:
        desk.up("--detach", "--pace", "lockstep", "--seed", "3")
        with join("cell") as bus:
            watch = Watch(bus, desk)
            watch.goes_on(100)
            watch.demand("standstill")
        os.kill(desk.find("dtwin up"), signal.SIGKILL)
        until(lambda: not desk.processes(), "its services end", PATIENCE)
        desk.up("--detach", "--pace", "lockstep", "--seed", "3")
        with join("cell") as bus:
            watch = Watch(bus, desk)
            watch.goes_on(100)
            assert watch.stop() == "torque off"
            until(lambda: desk.summary()["services"]["emulator"]["state"] == "stopped", "the table says so", PATIENCE)
            assert "kept until somebody releases it" in desk.summary()["services"]["bridge"]["last_error"]
            last = watch.tick
            assert not watch.obeyed()[:last].any()
            assert desk.run("release") == "none: the arm moves\n"
            until(lambda: watch.obeyed()[last:].any(), "the arm moves", PATIENCE)
            watch.demand("standstill")
        desk.run("down")
        assert not list((desk.folder / "dtwin").glob("cell.journal*"))
        desk.up("--detach", "--pace", "lockstep", "--seed", "3")
        with join("cell") as bus:
            assert Watch(bus, desk).stop() == "none"
        desk.run("down")
