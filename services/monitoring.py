"""Watches the running arm: samples and commands off the bus in, verdicts and residuals out.

A sample comes with what acted on the arm after it once the few ticks that are told together have passed, or at once
to a monitor that may stop the arm, as soon as something has begun.
What is lost on the way is counted and bridged by the monitor; what waits, because the computer is busy, is not lost,
and how late that makes it is said. When the service starts again, it hears again what it
has heard before, and so knows what it knew. It may ask the function blocks for a safe stop.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.bus.following import Following, following_ticks
from dtwin.bus.messages import (
    ACTED,
    RESIDUALS,
    SENSORS,
    TICKS,
    TOGETHER,
    VOLTAGES,
    Acted,
    PassedTick,
    PassedTicks,
)
from dtwin.bus.passed import Prompt
from dtwin.bus.ticks import Tick
from dtwin.bus.twin_messages import AcknowledgeRequest, MonitoringResiduals, WatchRequest
from dtwin.identification.machine.record import read_record
from dtwin.identification.model import read_model
from dtwin.monitoring.estimation.belief import Belief, commissioned, data_sheet, identified
from dtwin.monitoring.estimation.tuning import tuning_for
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.readiness.rehearsal import Rehearsal
from dtwin.monitoring.settings import ALARMS_PER_HOUR, MonitorSettings
from dtwin.monitoring.tracking.samples import Samples
from dtwin.parameters import JointVector, every_joint, joint_vector
from dtwin.run.options import CellFileOption
from dtwin.services.parts.readiness.preparation import prepare
from dtwin.services.parts.stopping.demands import Demands, Failure
from dtwin.services.parts.watching.behind import Behind
from dtwin.services.parts.watching.heard import Heard
from dtwin.services.parts.watching.watch import Watch
from dtwin.services.service import Link, Service, main
from dtwin.signals import Sensors, Voltages

log = logging.getLogger(__name__)

NAME: Final = "monitoring"
UNHEARD: Final[JointVector] = every_joint(0.0)
"""rad: without a model the monitor judges the noise by the readings alone"""
RESIDUAL_EVERY: Final = 2 * TOGETHER
"""ticks, a multiple of those that are told together"""
HEARD: Final = PassedTicks, AcknowledgeRequest, WatchRequest
"""Messages by which a monitor becomes what it is."""
VERDICT_EVERY: Final = 5 * TOGETHER
"""Ticks, such a multiple too: twice in the time for which a verdict counts."""


@dataclass(frozen=True, kw_only=True)
class Options(CellFileOption, Link):
    """Watch the arm of a running cell and say when something is wrong with it."""

    model: Path | None = None
    """Identified model of the healthy arm; the data sheet's arm if not given."""
    commissioned: Path | None = None
    """Record of the healthy arm that `dtwin commission` wrote, instead of a model."""
    alarms_per_hour: float = ALARMS_PER_HOUR
    """False alarms to be expected of a healthy arm."""
    safe_stop: bool = False
    """Ask the function blocks to stop the arm when a failure is confirmed."""
    heard: Path | None = None
    """Folder, which is there, for what the service hears, from which it knows it again when it is started again."""

    def run(self) -> int:
        belief = self._belief()
        settings = MonitorSettings(alarms_per_hour=self.alarms_per_hour, tuning=tuning_for(self.task().boxes))
        with Service(NAME, self) as service:
            prepare(service, Rehearsal(belief, settings).parts())
            demands = Demands(service.bus) if self.safe_stop else None
            heard = Heard(self.heard, HEARD)
            Monitoring(service, lambda: Monitor(belief, settings), self._words(), heard, demands).run()
        return 0

    def _words(self) -> str:
        if self.commissioned is not None:
            return f"record {self.commissioned.name}"
        return "the data sheet's arm" if self.model is None else f"model {self.model.parent.name}/{self.model.name}"

    def _belief(self) -> Belief:
        if self.commissioned is not None:
            return commissioned(read_record(self.commissioned))
        return data_sheet(UNHEARD) if self.model is None else identified(read_model(self.model))


class Monitoring:
    """One arm under watch.

    Args:
        service: frame of the service.
        made: makes a monitor that begins with the model.
        model: model or record of the healthy arm in words.
        heard: what an earlier process has heard, and where this one keeps what it hears.
        demands: passes failures on to the safe stop; None without it.
    """

    def __init__(
        self, service: Service, made: Callable[[], Monitor], model: str, heard: Heard, demands: Demands | None = None
    ) -> None:
        self._service = service
        self._watch = Watch(
            service,
            made,
            model,
            demands,
            heard,
            standing=lambda monitor: frozenset(monitor.findings.current),
            failures=lambda monitor: [Failure.of(finding) for finding in monitor.findings.history],
        )
        self._time, self._behind = 0.0, Behind()
        bus = service.bus
        self._tell_residuals: Callable[[MonitoringResiduals], None] = bus.publisher(RESIDUALS)
        self._prompt = Prompt(self._arrived)
        if demands is None:
            bus.subscribe(TICKS, PassedTicks, following_ticks(self._arrived, bus.refuse))
        else:  # Who may stop the arm hears of every tick as soon as it has passed.
            bus.subscribe(SENSORS, Sensors, Following(self._prompt.put, bus.refuse))
            bus.subscribe(VOLTAGES, Voltages, self._prompt.put)
            bus.subscribe(ACTED, Acted, self._prompt.put)

    def run(self) -> None:
        """Works until it is asked to end."""
        service, watch, done = self._service, self._watch, 0
        watch.recall(self._take)
        service.ready()
        while not service.stopping:
            item = service.next(0.2)
            before = done
            self._take(item)
            if isinstance(item, list) and watch.running:
                done += len(item)
                if said := self._behind.looked(self._time):
                    log.warning("%s", said)
            if service.report_due() or (done and not before):
                service.report(watch.state(done), done, time=self._time)

    def _arrived(self, ticks: list[Tick]) -> None:
        """Takes ticks that come from the bus, on its thread."""
        self._behind.came(ticks[-1][0].time)
        self._service.inbox.put(ticks)

    def _take(self, item: object) -> None:
        """Takes what comes from the bus, or has come to an earlier process."""
        watch = self._watch
        if isinstance(item, PassedTicks):
            item = [(tick.sensors, tick.acted) for tick in item.ticks]
        if isinstance(item, list):
            self._time = item[-1][0].time
            if watch.running:
                self._follow(item)
                watch.keep(told_together(item))
        else:
            watch.deal_with(item, self._time)

    def _follow(self, ticks: Sequence[Tick]) -> None:
        monitor, seen, done = self._watch.monitor, samples(ticks), 0
        while done < len(ticks):
            done += monitor.follow(seen.part(slice(done, None)))
            sensors = ticks[done - 1][0]
            if sensors.sequence % RESIDUAL_EVERY == 0 and not self._watch.recalling:
                self._tell_residuals(residuals(sensors.sequence, sensors.theta, monitor))
            if not self._watch.tell_news() and sensors.sequence % VERDICT_EVERY == 0:
                self._watch.tell_verdict()
        self._prompt.size = TOGETHER if monitor.calm else 1


def told_together(ticks: Sequence[Tick]) -> PassedTicks:
    """Ticks as one message, at most TOGETHER."""
    return PassedTicks(
        tuple(
            PassedTick(sensors, Acted(acted.sequence, acted.time, acted.volts, acted.box_gripped))
            for sensors, acted in ticks
        )
    )


def samples(ticks: Sequence[Tick]) -> Samples:
    """What sensors and commands said in ticks."""
    return Samples(
        np.array([sensors.sequence for sensors, _ in ticks]),
        np.array([sensors.theta for sensors, _ in ticks]),
        np.array([acted.volts for _, acted in ticks]),
        np.array([acted.box_gripped for _, acted in ticks]),
        np.array([sensors.gripper for sensors, _ in ticks]),
    )


def residuals(sequence: int, theta: JointVector, monitor: Monitor) -> MonitoringResiduals:
    """The last sample's residuals as they are published; theta are its angles, rad."""
    innovation = monitor.estimator.innovation
    return MonitoringResiduals(
        sequence,
        monitor.time,
        joint_vector(np.array(theta) - innovation),
        joint_vector(innovation),
        joint_vector(np.sqrt(monitor.estimator.variance)),
        monitor.statistic,
        monitor.threshold,
    )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
