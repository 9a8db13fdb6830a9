"""Records what passes on the bus: a Parquet log, a Rerun recording, a viewer.

Rows are put together from samples, truth, commands and paths by their numbers. What has come is kept twice a second,
so that a kill costs at most that; a recorder that starts again goes on. Numbers that go back begin another file.
"""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from dtwin.bus.following import Following
from dtwin.bus.messages import EVENTS, MONITORING, PATH, RESIDUALS, SENSORS, TRUTH, VOLTAGES, State
from dtwin.bus.messages import Path as PathAngles
from dtwin.bus.twin_messages import MonitoringResiduals, MonitoringVerdict
from dtwin.errors import ParameterError
from dtwin.parameters import ArmParameters
from dtwin.run.options import ArmOptions
from dtwin.run.recording import Log, RunLog, ensure_writable
from dtwin.signals import Event, EventKind, Sensors, StepRecord, Truth, Voltages
from dtwin.view import LiveView, Ports, Predictions, Viewer, ViewerProcess
from services.parts.log_parts import Parts
from services.parts.rows import Rows
from services.service import Link, Service, main

log = logging.getLogger(__name__)

NAME: Final = "recorder"
FLUSH: Final = 0.5
"""s between two parts"""
RECORDINGS: Final = 50
"""Number of recordings of one run; every reset of the cell begins another one."""
QUIET: Final = 0.3
"""s without a message after which nothing more is on its way at the end"""


@dataclass(frozen=True, kw_only=True)
class Options(ArmOptions, Link):
    """Record the run on the bus."""

    log: Path | None = None
    """Parquet log to write."""
    record: Path | None = None
    """Recording for the Rerun viewer to write."""
    viewer: Viewer = "none"
    """Show the run live: in a window of the Rerun viewer, or in a browser (web), on the loopback interface only."""
    monitored: bool = False
    """Draw what the monitoring service says, too."""
    ports: Ports = field(default_factory=Ports)
    """Where the viewer listens."""
    notes: str = "{}"
    """What the log shall say about how the run was made, as a JSON object."""

    def run(self) -> int:
        try:
            notes = msgspec.json.decode(self.notes, type=dict[str, Any])
        except msgspec.MsgspecError as error:
            raise ParameterError(f"--notes: expected a JSON object: {error}") from None
        for path in (self.log, self.record):
            if path is not None:
                ensure_writable(path)
        arm = self.parameters()
        with Service(NAME, self) as service:
            recorder = Recorder(service, self, notes, arm)
            try:
                recorder.run()
            finally:
                recorder.close()
        return 0


class Recorder:
    """Collects rows and keeps them."""

    def __init__(self, service: Service, options: Options, notes: dict[str, Any], arm: ArmParameters) -> None:
        self._service = service
        self._options = options
        self._notes = notes
        self._arm = arm
        self._runs = 0
        self._ticks = 0
        self._over = False
        self._run_log = RunLog()
        self._rows = Rows(self._add_row, self._begin_another)
        self._parts: Parts | None = None
        self._view: LiveView | None = None
        kind = options.viewer
        self._viewer = ViewerProcess(kind, options.ports) if kind != "none" else None
        self._time = 0.0
        self._residuals: list[MonitoringResiduals] = []
        self._verdicts: list[MonitoringVerdict] = []
        self._begin()
        bus = service.bus
        self._tell = bus.publisher(EVENTS)
        take = service.inbox.put
        rows = self._rows
        following = Following(lambda message: take((rows.sensors, message)), bus.refuse)
        bus.subscribe(SENSORS, Sensors, following)
        bus.subscribe(TRUTH, Truth, lambda message: take((rows.truth, message)))
        bus.subscribe(VOLTAGES, Voltages, lambda message: take((rows.answer, message)))
        bus.subscribe(PATH, PathAngles, lambda message: take((rows.answer, message)))
        bus.subscribe(EVENTS, Event, lambda message: take((self._take_event, message)))
        if options.monitored:
            bus.subscribe(RESIDUALS, MonitoringResiduals, lambda message: take((self._take_residuals, message)))
            bus.subscribe(MONITORING, MonitoringVerdict, lambda message: take((self._take_verdict, message)))

    def run(self) -> None:
        """Records until it is asked to end, and what was on its way then."""
        service = self._service
        service.ready()
        due = time.monotonic() + FLUSH
        while not service.stopping:
            self._deal_with(service.next(due - time.monotonic()))
            if time.monotonic() >= due:
                self._keep()
                due = time.monotonic() + FLUSH
            if service.report_due():
                self._report("running")
        while (item := service.next(QUIET)) is not None:
            self._deal_with(item)
        self._report("stopping")

    def close(self) -> None:
        """Writes the rest."""
        self._rows.flush()
        self._end()
        if self._viewer is not None:
            self._viewer.close()

    def _deal_with(self, item: tuple[Callable[..., None], Any] | None) -> None:
        if item is not None:
            receive, message = item
            receive(message, time.monotonic())

    def _take_event(self, event: Event, now: float) -> None:
        self._rows.event(event)
        if not self._over:
            self._run_log.add_events([event])

    def _take_residuals(self, message: MonitoringResiduals, now: float) -> None:
        self._residuals.append(message)

    def _take_verdict(self, message: MonitoringVerdict, now: float) -> None:
        self._verdicts.append(message)

    def _add_row(self, record: StepRecord) -> None:
        self._run_log.append(record)
        self._time = record.sensors.time
        self._ticks += 1

    def _keep(self) -> None:
        """Keeps what has come since the last time."""
        part = self._run_log.freeze()
        if not len(part):
            return
        self._run_log = RunLog()
        if not self._joined:
            self._join(part)
        if self._parts is not None:
            self._parts.add(part)
        if self._view is not None:
            self._view.add(part)
            self._view.add_monitoring(predictions(self._residuals), self._verdicts)
        self._residuals, self._verdicts = [], []

    def _join(self, part: Log) -> None:
        """Goes on with what an earlier recorder left, if this part follows it."""
        self._joined = True
        if self._parts is None or not self._parts.logs:
            return
        last, first = self._parts.logs[-1].columns["t"][-1], part.columns["t"][0]
        if first <= last:
            self._parts.clear()
            return
        log.warning("goes on with a log that ends at %.2f s; %.2f s are missing", last, first - last)
        if self._view is not None:
            for earlier in self._parts.logs:
                self._view.add(earlier)

    def _begin(self) -> None:
        """Opens what is to be written; after the first run the names get a number."""
        self._joined = False
        self._runs += 1
        options = self._options
        if options.log is not None:
            self._parts = Parts(self._numbered(options.log))
            if self._runs > 1:
                self._parts.clear()
        if options.record is not None or options.viewer != "none":
            file = None if options.record is None else self._numbered(options.record)
            url = "" if self._viewer is None else options.ports.data_url
            self._view = LiveView(options.mjcf, self._arm, file, url, options.monitored)

    def _numbered(self, path: Path) -> Path:
        return path if self._runs == 1 else path.with_stem(f"{path.stem}-{self._runs}")

    def _begin_another(self) -> bool:
        """Whether another recording could begin."""
        if self._runs == RECORDINGS:
            self._over = True
            text = f"the cell has started anew: nothing is recorded any more after {RECORDINGS} recordings"
            log.error("%s", text)
            self._tell(Event(0.0, EventKind.RECORDING, text))
            return False
        log.warning("the cell has started anew after %.2f s: another recording begins", self._time)
        self._end()
        self._begin()
        return True

    def _end(self) -> None:
        self._keep()
        if self._parts is not None:
            self._parts.finish(self._notes)
        if self._view is not None:
            self._view.close()

    def _report(self, state: State) -> None:
        self._service.report(state, self._ticks, time=self._time, late_ticks=self._rows.late)


def predictions(messages: Sequence[MonitoringResiduals]) -> Predictions:
    """What the monitor expected, as it is drawn."""
    predicted = np.array([message.predicted for message in messages]).reshape(-1, 3)
    return Predictions(
        np.array([message.time for message in messages]),
        predicted + np.array([message.residual for message in messages]).reshape(-1, 3),
        predicted,
        np.array([message.deviation for message in messages]).reshape(-1, 3),
        np.array([message.evidence for message in messages]),
        messages[-1].threshold if messages else 0.0,
    )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
