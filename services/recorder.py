"""Records what passes on the bus: a Parquet log, a Rerun recording, a viewer.

Rows are put together from samples, truth, commands and paths by their numbers. What has come is kept twice a second,
so that a kill costs at most that; a recorder that starts again goes on. Numbers that go back begin another file.
"""

from __future__ import annotations

import logging
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import msgspec

from dtwin.bus.following import Following
from dtwin.bus.messages import ACTED, EVENTS, MONITORING, PATH, RESIDUALS, SENSORS, TRUTH, VOLTAGES, Acted, State
from dtwin.bus.messages import Path as PathAngles
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import MonitoringResiduals, MonitoringVerdict
from dtwin.errors import ParameterError, RecordingError
from dtwin.logs.log import Log
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.run.options import ArmOptions
from dtwin.services.parts.log_parts import Parts
from dtwin.services.parts.missed.catching_up import catch_up
from dtwin.services.parts.missed.leaving import LastMessages
from dtwin.services.parts.part_files import discard_parts, first_recording, mark_begun, numbered
from dtwin.services.parts.readiness.ghost import believed, prepare_ghost
from dtwin.services.parts.recording.collected import Collected
from dtwin.services.parts.recording.disk import DiskNews
from dtwin.services.parts.recording.drawing import Drawing
from dtwin.services.parts.recording.verdicts import Verdicts
from dtwin.services.parts.rows import LOSSLESS_PATIENCE, PATIENCE, Rows
from dtwin.services.service import Link, Service, main
from dtwin.signals import Event, EventKind, Sensors, Truth, Voltages
from dtwin.view.viewer import Detail, Ports, Viewer, ViewerProcess, has_gpu

if TYPE_CHECKING:
    from dtwin.view.live import LiveView

log = logging.getLogger(__name__)

NAME: Final = "recorder"
FLUSH: Final = 0.5
"""s between two parts"""
RECORDINGS: Final = 50
"""Number of recordings of one run; every reset of the cell begins another one."""


@dataclass(frozen=True, kw_only=True)
class Options(ArmOptions, Link):
    """Record the run on the bus."""

    log: Path | None = None
    """Parquet log to write."""
    resumable: bool = False
    """Go on with the log that an earlier recorder of the same run has left, or begin another recording where there is
    no log, and leave marks for the next recorder."""
    record: Path | None = None
    """Recording for the Rerun viewer to write."""
    detail: Detail = "screen"
    """What the recording holds: what a screen can show, or every sample (full), which takes several times as much."""
    viewer: Viewer = "none"
    """Show the run live: in a window of the Rerun viewer, or in a browser (web), on the loopback interface only."""
    lossless: bool = False
    """Wait long for what belongs to a row, because no message of the cell is lost."""
    monitored: bool = False
    """Draw what the monitoring service says, too."""
    commissioned: Path | None = None
    """Record of the healthy arm that `dtwin commission` wrote, which the ghost is; without it the ghost is the arm
    that the controller was started to believe in."""
    ports: Ports = field(default_factory=Ports)
    """Where the viewer listens."""
    notes: str = "{}"
    """What the log shall say about how the run was made, as a JSON object."""

    def views(self, arm: ArmParameters, notes: dict[str, Any]) -> Callable[[int], LiveView] | None:
        """Opens the recording of a number, or a view without a file; None where nothing is drawn.

        Args:
            arm: arm that is drawn.
            notes: what the log says about how the run was made, from which the ghost is known.
        """
        if self.record is None and self.viewer == "none":
            return None
        ghost = cache(lambda: believed(self.commissioned, notes))

        def view(number: int) -> LiveView:
            from dtwin.view.live import LiveView  # loads Rerun and MuJoCo, which a log alone does not need

            file = None if self.record is None else numbered(self.record, number)
            sparse = file is None and self.viewer == "web" and not has_gpu()
            detail: Detail | Literal["sparse"] = "sparse" if sparse else self.detail
            url = "" if self.viewer == "none" else self.ports.data_url
            return LiveView(self.mjcf, arm, file, url, self.monitored, detail, self.task(), ghost())

        return view

    def run(self) -> int:
        try:
            notes = msgspec.json.decode(self.notes, type=dict[str, Any])
        except msgspec.MsgspecError as error:
            raise ParameterError(f"--notes: expected a JSON object: {error}") from None
        arm = self.made()
        with Service(NAME, self) as service:
            if self.record is not None or self.viewer != "none":
                prepare_ghost(service, self.commissioned, notes)
            recorder = Recorder(self, notes, arm, service.bus.publisher(EVENTS))
            try:
                recorder.listen(service)
                recorder.run(service)
            finally:
                recorder.close()
        return 0


class Recorder:
    """Collects rows and keeps them; a disk that is full costs what memory cannot hold and nothing else.

    Args:
        options: what to write and to show.
        notes: what the log says about how the run was made.
        arm: arm that is drawn.
        tell: receives events about the files.

    Attributes:
        rows: what takes the messages that rows are put together from.

    Raises:
        DtwinError: a file cannot be written for another reason than a full disk, or the viewer does not start.
    """

    def __init__(
        self, options: Options, notes: dict[str, Any], arm: ArmParameters, tell: Callable[[Event], None]
    ) -> None:
        self._tell = tell
        self._options = options
        self._notes = notes
        self._runs = first_recording(options.log, options.record, options.resumable)
        self._over = False
        self._collected = Collected()
        patience = LOSSLESS_PATIENCE if options.lossless else PATIENCE
        self.rows = Rows(self._collected.add, self._begin_another, patience=patience)
        self._parts: Parts | None = None
        self._disk = DiskNews(tell, lambda: self._collected.time)
        viewer = ViewerProcess(options.viewer, options.ports) if options.viewer != "none" else None
        self._drawing = Drawing(options.views(arm, notes), viewer, options.record, self._disk)
        self._verdicts = Verdicts()
        self._caught: dict[int, Sensors] = {}
        if options.log is not None and self._runs > 1:
            Parts(numbered(options.log, self._runs - 1)).finish(notes)  # A kill may have come while it was written.
        self._open()

    def listen(self, service: Service) -> None:
        """Puts what passes on the bus into the inbox of the service."""
        bus = service.bus
        take = service.inbox.put
        rows, verdicts = self.rows, self._verdicts
        following = Following(lambda message: take((self._take_sensors, message)), bus.refuse)
        bus.subscribe(SENSORS, Sensors, following)
        bus.subscribe(TRUTH, Truth, lambda message: take((rows.truth, message)))
        bus.subscribe(VOLTAGES, Voltages, lambda message: take((rows.answer, message)))
        bus.subscribe(ACTED, Acted, lambda message: take((rows.acted, message)))
        bus.subscribe(PATH, PathAngles, lambda message: take((rows.answer, message)))
        bus.subscribe(EVENTS, Event, lambda message: take((self.take_event, message)))
        if self._options.monitored:
            bus.subscribe(RESIDUALS, MonitoringResiduals, lambda message: take((verdicts.take_residuals, message)))
            bus.subscribe(MONITORING, MonitoringVerdict, lambda message: take((verdicts.take_verdict, message)))

    def run(self, service: Service) -> None:
        """Records until it is asked to end, and what was on its way then."""
        # An emulator that is about to leave waits until it is told that all rows are there.
        last = LastMessages(service, (lambda *_: self._report(service, "running"), None))
        self._catch_up(service.bus)
        service.ready()
        due = time.monotonic() + FLUSH
        while not service.stopping:
            self._deal_with(service.next(due - time.monotonic()))
            if time.monotonic() >= due:
                self._verdicts.judge(self._collected.time, time.monotonic(), self._options.monitored)
                self.keep()
                due = time.monotonic() + FLUSH
            if service.report_due():
                self._report(service, "running")
        for _ in range(service.inbox.qsize()):
            self._deal_with(service.next(0.0))
        for item in last:
            self._deal_with(item)
        self._report(service, "stopping")

    def close(self) -> None:
        """Writes the rest."""
        self.rows.flush()
        self._end(over=True)
        self._drawing.close()

    def _deal_with(self, item: tuple[Callable[..., None], Any] | None) -> None:
        if item is not None:
            receive, message = item
            receive(message, time.monotonic())

    def _catch_up(self, bus: Bus) -> None:
        """Asks for what passed since the last row that an earlier recorder has kept."""
        if self._parts is not None and self._parts.last > -math.inf:
            since = round(self._parts.last / PERIOD) + 1
            self._caught = catch_up(bus, self.rows, since, time.monotonic())

    def _take_sensors(self, sample: Sensors, now: float) -> None:
        """Takes a sample, unless it was caught up with before it came."""
        if self._caught.pop(sample.sequence, None) != sample:
            self.rows.sensors(sample, now)

    def take_event(self, event: Event, now: float) -> None:
        """Takes an event."""
        if not self._over:
            self._collected.add_event(event)

    def keep(self) -> None:
        """Keeps what has come since the last time, and draws it."""
        part = self._collected.take()
        if not len(part):
            return
        if not self._joined:
            part = self._joined_to(part)
            if not len(part):
                return
        if self._parts is not None and not self._over:
            self._parts.add(part)
            self._disk.announce_of(self._parts)
        self._drawing.add(part, self._parts, self._verdicts, self._runs)

    def _joined_to(self, part: Log) -> Log:
        """The first part, or what of it follows the rows that an earlier recorder left.

        Rows of an earlier time are those of another recording, which the cell has begun while nobody recorded. Where
        there is no log, the recording that these rows begin is marked, so that no later recorder writes over it.
        """
        options = self._options
        if options.log is None and options.record is not None and options.resumable:
            mark_begun(options.record, self._runs)
        last, first = -math.inf if self._parts is None else self._parts.last, part.columns["t"][0]
        if first < last:
            self._begin_another()
        elif first == last:
            part = part.part(1, len(part))
        elif last > -math.inf and (missing := first - last - PERIOD) > 0.5 * PERIOD:
            log.warning("goes on with a log that ends at %.2f s; %.2f s are missing", last, missing)
        self._joined = True
        self._drawing.draw_from_start(first >= last > -math.inf)
        return part

    def _open(self) -> None:
        """Opens what is to be written."""
        self._joined = False
        if self._options.log is not None:
            self._parts = Parts(numbered(self._options.log, self._runs))
            self._disk.announce_of(self._parts)
        self._drawing.open(self._runs)

    def _begin_another(self) -> bool:
        """Whether another recording could begin."""
        if self._runs >= RECORDINGS:
            self._over = True
            text = f"the cell has started anew: nothing is recorded any more after {RECORDINGS} recordings"
            log.error("%s", text)
            self._tell(Event(0.0, EventKind.RECORDING, text))
            return False
        log.warning("the cell has started anew after %.2f s: another recording begins", self._collected.time)
        options = self._options
        if options.log is not None and options.resumable:
            mark_begun(options.log, self._runs + 1)  # Who goes on after a kill must not write over what is finished.
        self._end()
        self._runs += 1
        if options.log is not None:
            discard_parts(numbered(options.log, self._runs))
        self._open()
        return True

    def _end(self, over: bool = False) -> None:
        """Finishes the files; when all is over also what came after the last row, else of the next run."""
        self.keep()
        late = self._collected.events() if over else ()
        self._drawing.draw_rest(self._parts)
        if self._parts is not None:
            try:
                if self._parts.finish(self._notes, late) and self._options.resumable:
                    self._parts.mark_whole()
            except RecordingError as error:
                self._disk.announce(str(error))
        self._drawing.end()

    def _report(self, service: Service, state: State) -> None:
        if self._drawing.waits or (self._parts is not None and self._parts.waiting):
            self._disk.repeat()
        collected = self._collected
        service.report(state, collected.ticks, time=collected.time, late_ticks=self.rows.late)


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
