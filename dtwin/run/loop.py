"""One tick of the controlled machine, and a run of many.

    sensors = plant.read(); voltages = controller.step(sensors); plant.apply(voltages); plant.advance(period)

Nothing downstream re-enters the tick. ControlledPlant time comes from the plant; only `Pacer` knows the wall clock.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from dtwin.errors import ParameterError
from dtwin.parameters import PERIOD, Triple
from dtwin.signals import Sensors, StepRecord, Truth, Voltages

CHUNK = 100
"""ticks between two calls of `between`: one second of plant time"""


class ControlledPlant(Protocol):
    """What is controlled; the emulation, or any other machine with the same signals."""

    def read(self) -> Sensors: ...
    def truth(self) -> Truth: ...
    def apply(self, voltages: Voltages) -> None: ...
    def advance(self, period: float) -> None: ...


class Controller(Protocol):
    """What answers a sample with a command."""

    def step(self, sensors: Sensors) -> Voltages: ...
    def target(self) -> Triple:
        """The path's angles (rad) of the last step."""


class Pacer:
    """Keeps a run from being faster than the wall clock.

    A late tick is not made up for by a burst: the schedule moves on from it.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._due = time.monotonic()
        self.late = 0

    def wait(self) -> None:
        """Returns when the next tick is due."""
        self._due += self._period
        remaining = self._due - time.monotonic()
        if remaining > 0:
            time.sleep(remaining)
        else:
            self.late += 1
            self._due -= remaining


def tick_count(duration: float, period: float = PERIOD) -> int:
    """Number of whole ticks in a duration in s.

    Raises:
        ParameterError: the duration is not finite, or shorter than one tick.
    """
    if not period <= duration < float("inf"):
        raise ParameterError(f"duration: expected at least one period of {period} s, got {duration}")
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
) -> int:
    """Runs the closed loop.

    Args:
        ticks: how many to run.
        record: receives every tick's record.
        between: called with the number of ticks done every `CHUNK` ticks and at the end; False ends the run.
        pacer: makes the run no faster than real time.
        period: s, of the controller.

    Returns:
        the number of ticks done.

    Raises:
        DtwinError: what plant and controller raise; all earlier ticks are recorded.
    """
    done = 0
    while done < ticks:
        for _ in range(min(CHUNK, ticks - done)):
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
