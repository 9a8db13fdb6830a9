"""Watches a running arm of n joints: ticks off the bus in, verdicts out.

It learns the arm from its motion first, unless a record of it is given. Ticks that were lost are bridged on a
straight line if they are few, else what comes afterwards is a stretch of its own. When the service starts again, it
hears again what it has heard before, and so knows what it knew.
"""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Array
from dtwin.bus.chain.messages import JointAdjustment, JointTicks
from dtwin.bus.messages import ADJUSTED, JOINT_TICKS
from dtwin.bus.twin_messages import AcknowledgeRequest, WatchRequest
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.monitor import ArmMonitor
from dtwin.monitoring.chain.record import ArmRecord, read_arm_record
from dtwin.monitoring.chain.sequential import HEALTHY
from dtwin.run.chain import ChainSettings
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.chain.ticks import Rows
from dtwin.services.parts.readiness.preparation import prepare
from dtwin.services.parts.stopping.demands import Demands, Failure
from dtwin.services.parts.watching.heard import Heard
from dtwin.services.parts.watching.watch import Watch
from dtwin.services.service import Link, Service, main

log = logging.getLogger(__name__)

NAME: Final = "monitoring"
HEARD: Final = JointTicks, JointAdjustment, AcknowledgeRequest, WatchRequest
"""Messages by which a monitor becomes what it is."""
AT_ONCE: Final = 20
"""Ticks that are judged together: 0.2 s at 100 Hz."""
VERDICT_EVERY: Final = 0.4
"""Time between two verdicts, s: twice in the time for which one counts."""


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions, Link):
    """Watch an arm and say when something is wrong with it."""

    healthy: float = HEALTHY
    """Time in which the arm is healthy and is learned, s; longer where its motion does not suffice."""
    commissioned: Path | None = None
    """Record of the healthy arm that `dtwin commission` wrote; learned from its motion without one."""
    safe_stop: bool = False
    """Ask the function blocks to stop the arm when a failure is confirmed."""
    heard: Path | None = None
    """Folder, which is there, for what the service hears, from which it knows it again when it is started again."""

    def run(self) -> int:
        settings = self.settings()
        with Service(NAME, self) as service:
            prepare(service, [("the equations of the arm", lambda: _rehearse(settings))])
            demands = Demands(service.bus) if self.safe_stop else None
            record = None if self.commissioned is None else read_arm_record(self.commissioned, settings.arm)
            Watching(service, settings, self.healthy, record, Heard(self.heard, HEARD), demands).run()
        return 0


class Watching:
    """An arm under watch.

    Args:
        service: frame of the service.
        settings: run of the arm.
        healthy: time in which it is learned, s.
        record: the arm as it was commissioned; None if it is learned.
        heard: what an earlier process has heard, and where this one keeps what it hears.
        demands: passes failures on to the safe stop; None without it.
    """

    def __init__(
        self,
        service: Service,
        settings: ChainSettings,
        healthy: float,
        record: ArmRecord | None,
        heard: Heard,
        demands: Demands | None,
    ) -> None:
        self._service = service
        self._settings = settings
        self._healthy = healthy
        self._record = record
        self._done = 0
        self._adjustment = Adjustment.none(len(settings.arm))
        how = f"learned from its motion in {healthy:g} s"
        if record is not None:
            how = f"commissioned in {record.seconds:g} s"
        self._watch = Watch(
            service,
            self._monitor_anew,
            f"{settings.arm.name}, {how}",
            demands,
            heard,
            standing=lambda monitor: frozenset() if monitor.finding is None else frozenset({monitor.finding.cause}),
            failures=lambda monitor: [self._failure(found) for found in monitor.history],
        )
        bus = service.bus
        bus.subscribe(JOINT_TICKS, JointTicks, service.inbox.put)
        bus.subscribe(ADJUSTED, JointAdjustment, service.inbox.put)

    def run(self) -> None:
        """Works until it is asked to end."""
        service, watch = self._service, self._watch
        watch.recall(self._take)
        service.ready()
        while not service.stopping:
            self._take(service.next(0.2))
            if service.report_due():
                service.report(watch.state(self._done), self._done, time=watch.monitor.time)

    def _take(self, item: object) -> None:
        """Takes what comes from the bus, or has come to an earlier process."""
        if isinstance(item, JointTicks):
            self._on_ticks(item)
        elif isinstance(item, JointAdjustment):
            self._adjust(item)
        else:
            self._watch.deal_with(item, self._watch.monitor.time)

    def _monitor_anew(self) -> ArmMonitor:
        """A monitor that begins anew, as does what its rows are made from."""
        arm, record = self._settings.arm, self._record
        self._rows = Rows(arm, self._settings.late)
        self._next = 0.0
        return ArmMonitor(arm, self._healthy, None if record is None else record.watch(arm))

    def _adjust(self, message: JointAdjustment) -> None:
        """Goes on with what the blocks count on now, if that is something else than before."""
        now = message.adjustment
        if len(now.offset) == len(self._settings.arm) and now != self._adjustment:
            self._adjustment = now
            self._watch.monitor.adjust(now)
            self._watch.keep(message)
            self._watch.tell_news()

    def _on_ticks(self, passed: JointTicks) -> None:
        watch = self._watch
        if not watch.running:
            return
        for tick in passed.ticks:
            if len(tick.sensors.theta) != len(self._settings.arm):
                got, expected = len(tick.sensors.theta), len(self._settings.arm)
                self._service.bus.refuse("joints", f"a tick has {got}, expected {expected}")
                return
            missing = self._rows.add(tick)
            self._done += 1
            if missing < 0:
                watch.begin_anew()
                self._rows.add(tick)
            elif missing:
                watch.monitor.miss(missing)
        if len(self._rows) >= AT_ONCE:
            monitor = watch.monitor
            monitor.follow(*self._rows.drain())
            watch.tell_news()
            if monitor.time >= self._next:
                self._next = monitor.time + VERDICT_EVERY
                watch.tell_verdict()
        watch.keep(passed)

    def _failure(self, found: ChainFinding) -> Failure | None:
        if found.kind == "push":
            return None
        text = found.text(self._settings.arm)[:1000]
        return Failure(found.cause, text, "angles unknown" if found.angles_unknown else "failed", 1.0)


def _rehearse(settings: ChainSettings) -> None:
    """Goes through the whole work once, so that nothing is loaded or made ready after the service is."""
    arm = settings.arm
    generator = np.random.default_rng(0)
    t: Array = arm.period * np.arange(round(12.0 / arm.period), dtype=np.float64)
    phase = generator.uniform(0.0, 2.0 * np.pi, len(arm))
    q = 0.1 * np.sin(t[:, None] + phase)
    noise = generator.standard_normal(q.shape)
    monitor = ArmMonitor(arm, 10.0)
    monitor.follow(t, q, q, noise)
    monitor.verdict()


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
