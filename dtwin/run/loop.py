"""One tick of the controlled machine, and a run of many.

    sensors = plant.read(); voltages = controller.step(sensors); plant.apply(voltages); plant.advance(period)

What uses the records never acts back on the tick. Time is that of the plant; only `Pacer` reads the wall clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from dtwin.errors import ParameterError
from dtwin.parameters import PERIOD, JointVector
from dtwin.signals import Sensors, StepRecord, Truth, Voltages

CHUNK = 100
"""Number of ticks between two calls of `between`: one second of plant time."""
LONGEST = 864_000.0
"""Longest plant time of a run, s: ten days, whose log takes 13 GB of memory."""


class ControlledPlant(Protocol):
    """A plant that the loop can run: the emulation, or any other machine with the same signals."""

    def read(self) -> Sensors:
        """The sample that the sensors give now."""

    def truth(self) -> Truth:
        """The true state of the plant."""

    def apply(self, voltages: Voltages) -> None:
        """Sets the voltages until the next command."""

    def advance(self, period: float) -> None:
        """Lets the plant run for a period (s)."""


class Controller(Protocol):
    """A controller: it answers every sample with a command."""

    def step(self, sensors: Sensors) -> Voltages:
        """The command that answers a sample."""

    def target(self) -> JointVector:
        """Desired angles of the path at the last step, rad."""


class Pacer:
    """Keeps a run from being faster than real time.

    After a late tick the later ones are not hurried: the schedule shifts by the delay.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._due = time.monotonic()
        self.late = 0

    def wait(self) -> None:
        """Waits until the next tick is due."""
        self._due += self._period
        remaining = self._due - time.monotonic()
        if remaining > 0:
            time.sleep(remaining)
        else:
            self.late += 1
            self._due -= remaining


def tick_count(duration: float, period: float = PERIOD) -> int:
    """Number of whole ticks in a duration (s).

    Raises:
        ParameterError: the duration is not finite, shorter than one tick, or longer than LONGEST.
    """
    if not period <= duration <= LONGEST:
        allowed = f"at least one period of {period} s and at most {LONGEST:g} s"
        raise ParameterError(f"duration: expected {allowed}, got {duration:g}")
    return round(duration / period)


def run(
    plant: ControlledPlant,
    controller: Controller,
    ticks: int,
    *,
    record: Callable[[StepRecord], None] | None = None,
    between: Callable[[int], bool] | None = None,
    pacer: Pacer | None = None,
    period: float = PERIOD,
    ahead: Callable[[int], int] | None = None,
) -> int:
    """Runs the closed loop.

    Args:
        plant: the plant to control.
        controller: the controller to step.
        ticks: number of ticks to run.
        record: called with the record of every tick.
        between: called with the number of ticks done every `CHUNK` ticks and at the end; False ends the run.
        pacer: keeps the run from being faster than real time; None for as fast as possible.
        period: period of the controller, s.
        ahead: does as many of some ticks as it can, which may be none, in another way with the same result, records
            included, and tells how many.

    Returns:
        The number of ticks done.

    Raises:
        DtwinError: plant or controller failed; all ticks before are recorded.
    """
    done = 0
    while done < ticks:
        until = min(done + CHUNK, ticks)
        while done < until:
            if ahead is not None and (made := ahead(until - done)):
                done += made
                continue
            sensors = plant.read()
            voltages = controller.step(sensors)
            if record is not None:
                record(StepRecord(plant.truth(), sensors, controller.target(), voltages))
            plant.apply(voltages)
            plant.advance(period)
            done += 1
            if pacer is not None:
                pacer.wait()
        if between is not None and not between(done):
            break
    return done
