"""Work with effects around the plant, commissioned and watched as a real arm is: alarms, names and confidence."""

from __future__ import annotations

from typing import Final, NamedTuple

import msgspec
import numpy as np

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import STOP
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.emulation import Emulation
from dtwin.errors import IdentificationError
from dtwin.identification.machine.judged import identify_machine, record_of
from dtwin.identification.machine.record import MachineRecord
from dtwin.identification.machine.sensors import check_sensors
from dtwin.logs.collecting import RunLog
from dtwin.logs.log import Log
from dtwin.monitoring.calibration import watched
from dtwin.monitoring.estimation import belief as beliefs
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.monitoring.verdict import Finding
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.run.loop import run, tick_count
from dtwin.services.monitoring import UNHEARD
from dtwin.signals import EventKind, StepRecord
from tests.outside.around import Around
from tests.outside.effect import Effect, later, nothing, since
from tests.outside.table import EFFECTS, FAULTS

IDENTIFIED_FROM: Final = 120.0
"""Plant time of the log that an arm is identified from, the first part of the one that its monitor learns from, s."""
LEARNED_FROM: Final = 600.0
"""Plant time of that log, s."""
SHIFT: Final = 20.0
"""Minutes of work that are watched by one monitor."""
BEGINS: Final = 25.0
"""Plant time by which faults begin later than their table says, s: the monitor first has to see the arm move."""
STARTS: Final = 5.0
"""Plant time at which the faults of the table begin at the earliest, s."""
FOLLOWED: Final = 25.0
"""Plant time for which a fault is followed, s."""
NOISE: Final = 0.001
"""Magnitude of the encoder noise, rad."""
_SEEN: Final = 0.02
"""What a person sees: a joint, or its reading, that is so far from where it would be, rad."""
_MOVES: Final = 0.1
"""Velocity of a joint that moves, rad/s."""
_ALARMS: Final = (EventKind.FAILED, "push")
_NOTICED: Final = (EventKind.SUSPECTED, *_ALARMS, EventKind.MISFIT, EventKind.BURST, EventKind.SPIKE)
KINDS: Final[dict[str, Effect]] = EFFECTS | FAULTS | {"nothing": nothing}


class Work(NamedTuple):
    """Work with an effect or a fault of the table: its name, number of the generators, and of those of the effect."""

    what: str
    seed: int
    effect_seed: int = 0


class Worked(NamedTuple):
    """What became of work: its log, and the plant times of the first change by the effect and of a stop by the
    blocks, s; infinite if there was none."""

    log: Log
    began: float
    stopped: float


def work(item: Work, seconds: float, begins: float | None = None) -> Worked:
    """Lets the blocks sort boxes with an effect around the plant.

    Args:
        item: what work.
        seconds: plant time, s.
        begins: by how much later the effect begins than its table says, s; None if it has always been there.
    """
    effect = KINDS[item.what]
    if begins is not None:
        effect = since(later(effect, begins), begins + STARTS)
    plant = Around(Emulation(noise=NOISE, seed=item.seed), effect, item.effect_seed)
    controller = EmbeddedController(ControlSettings(law="cascade"))
    stop_now, log, stopped = controller.resource.reader((STOP,)), RunLog(), [np.inf]

    def record(step: StepRecord) -> None:
        log.append(step)
        if stop_now()[0] and step.sensors.time < stopped[0]:
            stopped[0] = step.sensors.time

    run(plant, controller, tick_count(seconds), record=record)
    return Worked(log.freeze(), plant.began, stopped[0])


def commission(item: Work) -> MachineRecord | str:
    """The record of an arm that was identified and watched at work with an effect, or why there is none."""
    log, arm = work(item, LEARNED_FROM).log, ArmParameters()
    part = log.part(0, round(IDENTIFIED_FROM / PERIOD))
    try:
        judged, sensors = identify_machine(part, arm), check_sensors(part)
    except IdentificationError as error:
        return str(error)
    return watched(record_of(judged, sensors, arm, item.what), stream(log))


class WatchedEffect(msgspec.Struct, frozen=True):
    """What a monitor made of healthy work with an effect.

    Attributes:
        hours: plant time, h.
        misfits: how often it said that the arm is not the one that it knows.
        alarms: what it said was wrong.
        stops: runs that the blocks stopped.
    """

    hours: float
    misfits: int
    alarms: list[str]
    stops: int


def watch_effect(job: tuple[Work, Belief, float]) -> WatchedEffect:
    """Watches healthy work for some minutes, in shifts each with a monitor that starts anew.

    Every alarm is acknowledged at once, so that the next one counts, too.
    """
    item, belief, left = job
    hours, misfits, stops, alarms = 0.0, 0, 0, list[str]()
    shift = 0
    while left > 1e-6:
        shift += 1
        done = work(item._replace(seed=1000 * item.seed + shift), 60.0 * min(left, SHIFT))
        monitor = followed(belief, done.log, True)
        alarms += [f"{event.time:.2f} s: {event.text}" for event in monitor.events if event.kind in _ALARMS]
        misfits += sum(event.kind == EventKind.MISFIT for event in monitor.events)
        stops += done.stopped < np.inf
        hours, left = hours + len(done.log) * PERIOD / 3600.0, left - SHIFT
    return WatchedEffect(hours, misfits, alarms, stops)


class WatchedFault(msgspec.Struct, frozen=True):
    """What a monitor made of a fault.

    Attributes:
        name: the fault, as in the table.
        early: alarms before it.
        seen: plant time from its begin until a person could see it, s; None if nobody could.
        after: motion from then on until the monitor noticed it, s; None if it did not.
        findings: the findings since it began, in order, while nobody acknowledged any.
        again: the same while each was acknowledged at once.
        stopped: plant time from its begin until the blocks stopped the arm, s; infinite if they did not.
    """

    name: str
    early: int
    seen: float | None
    after: float | None
    findings: list[Finding]
    again: list[Finding]
    stopped: float


def watch_fault(job: tuple[Work, Belief]) -> WatchedFault:
    """Lets a fault befall an arm at work that the monitor knows, at a time that follows from the seed."""
    item, belief = job
    begins = BEGINS + 1.7 * item.seed % 11.0
    seconds = begins + STARTS + FOLLOWED
    done = work(item, seconds, begins)
    alone = work(item._replace(what="nothing"), seconds)
    log, since_then = done.log, done.began - 1e-6
    monitor, other = followed(belief, log, False), followed(belief, log, True)
    times, angles = log.columns["t"], log.angles()
    off = np.abs(log.stack("measured") - angles).max(axis=1), np.abs(angles - alone.log.angles()).max(axis=1)
    visible = times[np.maximum(*off) > _SEEN]
    seen = float(visible[0]) if len(visible) else np.inf
    noticed = [event.time for event in monitor.events if event.kind in _NOTICED and event.time >= since_then]
    after = None
    if noticed:
        between = (times >= seen) & (times < min(noticed))
        after = round(float((np.abs(log.stack("omega")).max(axis=1) > _MOVES)[between].sum()) * PERIOD, 2)
    early = sum(event.kind in _ALARMS and event.time < done.began for event in monitor.events)
    findings, again = ([f for f in each.history if f.detected >= since_then] for each in (monitor, other))
    shown = round(seen - done.began, 2) if seen < np.inf else None
    return WatchedFault(item.what, early, shown, after, findings, again, done.stopped - done.began)


def followed(belief: Belief, log: Log, acknowledged: bool) -> Monitor:
    """A monitor that has seen a log, and whose alarms were acknowledged as they came, or not at all."""
    monitor, seen, done, heard = Monitor(belief), stream(log), 0, 0
    while done < len(seen):
        done += seen.follow(monitor, done, len(seen))
        if acknowledged and len(monitor.events) > heard and monitor.findings.current:
            monitor.acknowledge()
        heard = len(monitor.events)
    return monitor


def data_sheet() -> Belief:
    """What is believed of an arm that was never commissioned."""
    return beliefs.data_sheet(UNHEARD)
