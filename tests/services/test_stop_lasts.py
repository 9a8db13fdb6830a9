"""A stop lasts until its release, whatever is killed meanwhile: how the arm moved, and what is read of the stop.

The arm is judged by its motion: without voltage it moves as the equations of the free arm say. What is published of
commands would not do, since a process that has just begun may not have found all its listeners.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import pytest

from dtwin.bus.messages import (
    LATCH,
    RELEASE,
    RESET,
    STOP,
    TRUTH,
    Done,
    LatchState,
    ReleaseRequest,
    ResetRequest,
    StopRequest,
    StopState,
)
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError
from dtwin.parameters import HANGING, PERIOD, ArmParameters
from dtwin.services.runfile import join
from dtwin.signals import STOPS, ArmState, Truth
from dtwin.twin.dynamics import Array, gravity
from dtwin.twin.rollout import rollout
from tests.support.desk import Desk, new_desk
from tests.support.waiting import until

PATIENCE = 60.0
"""Deadline of every wait, s."""
FREE = 1e-9
"""Largest deviation of an arm without voltage from the equations of the free arm, rad and rad/s, over one tick; one
tick of 1 mV makes ten times as much."""
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
CASES = [
    *(("standstill", killed) for killed in ORDERS),
    *(("torque off", killed) for killed in ORDERS if len(killed) > 1),
]
"""Without torque there is nothing to hold: two killed services leave one that knows of the stop, one leaves two."""
AGAIN = pytest.mark.thorough
"""Marks what only thorough runs repeat: stops that begin without torque, which a standstill turns into anyway, and
two services at once, where usual runs kill each by itself and all three."""
BOTH = ["standstill", pytest.param("torque off", marks=AGAIN)]


class Watch:
    """A cell that is up, seen from outside.

    Args:
        bus: session that asks.
        hearing: session that hears of every tick; no answer waits behind them on its way.
        desk: desk at which the cell is up.
    """

    def __init__(self, bus: Bus, hearing: Bus, desk: Desk) -> None:
        self.bus = bus
        self.desk = desk
        self.truths: dict[int, Truth] = {}
        self.tick = 0
        self.resets = 0
        self.read: list[str] = []
        hearing.subscribe(TRUTH, Truth, self._keep)

    def _keep(self, truth: Truth) -> None:
        tick = round(truth.time / PERIOD)
        if tick < self.tick:  # The cell has been reset: samples of one publisher come in their order.
            self.truths.clear()
            self.resets += 1
        self.truths[tick] = truth
        self.tick = tick

    def stop(self) -> str:
        """The stop that is read, or "" while there is nobody to answer."""
        try:
            found = self.bus.ask(STOP, None, StopState, 1.0).stop
        except CommunicationError:
            return ""
        self.read.append(found)
        return found

    def catch_up(self) -> int:
        """Waits for all that the emulator has published until now, which a busy machine delivers late; its tick."""
        now = round(until(self.latched, "the emulator answers", PATIENCE).time / PERIOD)
        until(lambda: self.tick >= now, "all has come", PATIENCE)
        return now

    def latched(self) -> LatchState | None:
        """What the emulator keeps, or None while there is none to answer."""
        try:
            return self.bus.ask(LATCH, None, LatchState, 5.0)
        except CommunicationError:
            return None

    def goes_on(self, ticks: int) -> None:
        """Waits for so many ticks."""
        reached = self.catch_up()
        until(lambda: self.tick > reached + ticks, "the cell goes on", PATIENCE)

    def demand(self, stop: str) -> None:
        """Stops the arm."""
        self.bus.ask(STOP, StopRequest("anna", "look at it", DEMANDS[stop]), StopState)
        until(lambda: self.stop() == stop, f"the arm has its {stop}", PATIENCE)
        self.read = [stop]

    def release(self) -> int:
        """Ends the stop; returns a tick at which it was in force."""
        last = self.catch_up()
        assert self.bus.ask(RELEASE, ReleaseRequest("anna", "done"), StopState).stop == "none"
        return last

    def hangs(self) -> bool:
        """Whether the arm hangs as good as at rest."""
        self.catch_up()
        last = self.truths[self.tick]
        away = np.subtract(last.theta, HANGING)
        away -= 2.0 * np.pi * np.round(away / (2.0 * np.pi))  # A falling arm may go round.
        return float(np.abs((*away, *last.omega)).max()) < 0.05

    def driven(self, first: int, last: int) -> list[tuple[int, float]]:
        """Ticks from first to last over which the arm did not move freely, and by how much, rad or rad/s."""
        seen = [(k, self.truths[k]) for k in range(first, last + 1) if k in self.truths]
        found = []
        for (k, before), (next_k, after) in pairwise(seen):
            state, mass = (*before.theta, *before.omega), after.payload_mass  # A command lets go before it acts.
            free = rollout(ArmParameters(), state, np.zeros((next_k - k, 3)), mass)[-1]
            error = float(np.abs(free - (*after.theta, *after.omega)).max())
            if error > FREE * (next_k - k):
                found.append((k, error))
        return found

    def volts(self, tick: int) -> Array:
        """What acted over a tick, as the motion tells, (3,), V: speeds change with the voltages in proportion."""
        before, after = self.truths[tick], self.truths[tick + 1]
        state, mass = (*before.theta, *before.omega), after.payload_mass
        still, *pushed = (
            rollout(ArmParameters(), state, [volts], mass)[-1, 3:] for volts in np.vstack((np.zeros(3), np.eye(3)))
        )
        columns = np.column_stack(pushed) - still[:, None]
        return np.linalg.solve(columns, np.array(after.omega) - still).astype(np.float64)

    def assert_without_voltage(self, first: int, last: int) -> None:
        """The arm has moved freely over the ticks from first to last, of which enough are known."""
        assert len(self.truths.keys() & {*range(first, last)}) > 20
        assert not self.driven(first, last)

    def kill(self, names: tuple[str, ...]) -> None:
        """Kills services at once and waits until all are back."""
        before = self.restarts(names)
        pids = [self.desk.find(f"dtwin.services.{name}") for name in names]
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        until(lambda: self.restarts(names) == [n + 1 for n in before], "they start again", PATIENCE, self.stop)

    def restarts(self, names: tuple[str, ...]) -> list[int]:
        services = self.desk.summary()["services"]
        return [services[name]["restarts"] for name in names]


@contextmanager
def watched(desk: Desk) -> Iterator[Watch]:
    """The cell that is up at a desk."""
    with join("cell") as bus, join("cell") as hearing:
        yield Watch(bus, hearing, desk)


def test_a_stop_outlives_the_supervisor_but_not_an_orderly_end() -> None:
    with new_desk() as desk:
        desk.detach("--pace", "lockstep", "--seed", "3")
        with watched(desk) as watch:
            watch.goes_on(100)
            watch.demand("standstill")
        os.kill(desk.find("dtwin up"), signal.SIGKILL)
        until(lambda: not desk.processes(), "its services end", PATIENCE)
        desk.detach("--pace", "lockstep", "--seed", "3")
        with watched(desk) as watch:
            watch.goes_on(100)
            assert watch.stop() == "torque off"
            until(lambda: desk.summary()["services"]["emulator"]["state"] == "stopped", "the table says so", PATIENCE)
            kept = "kept until somebody releases it"
            until(lambda: kept in desk.summary()["services"]["bridge"]["last_error"], "and why", PATIENCE)
            last = watch.catch_up()
            watch.assert_without_voltage(0, last)
            assert desk.run("release") == "none: the arm moves\n"
            watch.goes_on(100)
            until(lambda: watch.driven(last, watch.tick), "the arm moves", PATIENCE)
            watch.demand("standstill")
        desk.run("down")
        assert not list((desk.folder / "dtwin").glob("cell.journal*"))
        desk.detach("--pace", "lockstep", "--seed", "3")
        with watched(desk) as watch:
            assert watch.stop() == "none"
        desk.run("down")


@pytest.fixture(scope="module")
def stopped(request: pytest.FixtureRequest) -> Iterator[tuple[Watch, str]]:
    """A cell shared by the orders, since starting it takes longer than killing its services.

    Each stop has a cell of its own: a service that is killed again and again is started after ever longer pauses.
    """
    with new_desk() as desk:
        desk.detach("--pace", "lockstep", "--seed", "3")
        with watched(desk) as watch:
            yield watch, request.param
        desk.run("down")


@pytest.mark.parametrize(
    ("stopped", "killed"),
    [
        pytest.param(
            stop, killed, id=f"{stop}-{'+'.join(killed)}", marks=[AGAIN] * (stop == "torque off" or len(killed) == 2)
        )
        for stop, killed in CASES
    ],
    indirect=["stopped"],
)
def test_only_a_release_ends_a_stop(stopped: tuple[Watch, str], killed: tuple[str, ...]) -> None:
    watch, stop = stopped
    watch.goes_on(200)
    watch.demand(stop)
    off = watch.catch_up()
    watch.kill(killed)
    until(lambda: watch.stop() == "torque off", "nobody knows any longer that the arm is held", PATIENCE)
    off = off if stop == "torque off" else watch.catch_up()
    watch.goes_on(300)
    assert watch.stop() == "torque off"
    ranks = [STOPS.index(found) for found in watch.read]
    assert ranks == sorted(ranks), "it never reads weaker than before"
    until(watch.hangs, "the arm has come to rest", PATIENCE)
    watch.assert_without_voltage(off, watch.tick)
    last = watch.release()
    until(lambda: watch.driven(last, watch.tick), "it moves again", PATIENCE)
    assert_no_jump(watch, last)


def assert_no_jump(watch: Watch, released: int) -> None:
    """Without a jump the voltages begin with what holds the arm where it is, and never grow by much in one tick."""
    (first, _), *_ = watch.driven(released, watch.tick)
    until(lambda: watch.truths.keys() >= {*range(first, first + 31)}, "it is heard", PATIENCE)
    arm, start = ArmParameters(), watch.truths[first]
    holding = gravity(np.array(start.theta), np.array(arm.vector()), start.payload_mass) / arm.voltage_constant
    volts = np.array([watch.volts(first + k) for k in range(30)])
    assert np.abs(volts[0] - holding).max() < 0.5
    assert np.abs(np.diff(volts, axis=0)).max() < 0.5
    theta = np.array([watch.truths[first + k].theta for k in range(30)])
    assert np.abs(np.diff(theta, axis=0)).max() < 0.03


@pytest.mark.parametrize("stopped", BOTH, indirect=True)
def test_a_reset_ends_no_stop(stopped: tuple[Watch, str]) -> None:
    watch, stop = stopped
    watch.demand(stop)
    before = watch.resets
    watch.bus.ask(RESET, ResetRequest(3), Done)
    until(lambda: watch.resets > before, "the cell has started anew", PATIENCE)
    until(lambda: watch.stop() == "torque off", "another arm stands there now", PATIENCE)
    watch.goes_on(100)
    assert "none" not in watch.read
    watch.assert_without_voltage(0, watch.tick)
    watch.release()
    watch.goes_on(100)


@pytest.mark.parametrize("stopped", BOTH, indirect=True)
def test_a_release_that_the_emulator_does_not_hear_is_refused(stopped: tuple[Watch, str]) -> None:
    watch, stop = stopped
    watch.demand(stop)
    emulator = watch.desk.find("dtwin.services.emulator")
    os.kill(emulator, signal.SIGSTOP)
    try:
        with pytest.raises(CommunicationError, match="not released, the torque is off"):
            watch.bus.ask(RELEASE, ReleaseRequest("anna", "done"), StopState, PATIENCE)
    finally:
        os.kill(emulator, signal.SIGCONT)
    until(lambda: watch.stop() == "torque off", "the blocks are stopped again", PATIENCE)
    off = watch.catch_up()
    watch.goes_on(100)
    assert watch.stop() == "torque off"
    watch.assert_without_voltage(off, watch.tick)
    watch.release()
    watch.goes_on(100)
