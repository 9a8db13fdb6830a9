"""A cell for the operator in one process: emulation, blocks, monitor and uploads in turn, faster than time.

What the services say and answer over the bus, these parts say and answer at once. The operator looks for a message,
and plant time passes until there is one. So a run is the same whenever it is repeated, whatever the computer does
beside it; what monitor and searches have to compute takes no plant time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, cast

from dtwin.bus.chain.messages import TOGETHER
from dtwin.bus.messages import EVENTS, FAULT, MONITORING, PREDICT, STOP, UPLOAD, Done, FaultRequest, StopRequest
from dtwin.bus.messages import StopState as Stopped
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.bus.twin_messages import Predicted, PredictionRequest, Upload, UploadRequest
from dtwin.controller.bounds import check_model
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import STOPPED, VERDICT
from dtwin.controller.settings import ControlSettings
from dtwin.controller.settings_port import EmbeddedPort
from dtwin.emulation.faults import parse_fault
from dtwin.errors import DtwinError
from dtwin.identification.machine.record import MachineRecord
from dtwin.logs.log import Log
from dtwin.monitoring.estimation.belief import commissioned
from dtwin.monitoring.estimation.tuning import tuning_for
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.monitoring.settings import MonitorSettings
from dtwin.parameters import joint_vector
from dtwin.recovery.desk import Desk, Message
from dtwin.run.cell import Cell
from dtwin.run.loop import run
from dtwin.run.machine_code.cell import CompiledTicks
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.services.monitoring import VERDICT_EVERY
from dtwin.services.parts.stopping.stops import OWN
from dtwin.services.parts.uploading.uploading import Uploading
from dtwin.services.service import Service
from dtwin.services.simulation import predicted, upload_of
from dtwin.signals import ARM_STATES, STOPS, Event, EventKind, Stop, of_monitor
from dtwin.simulation.checks import Checker
from dtwin.simulation.history import Entry, History
from dtwin.simulation.proposal import tolerated
from dtwin.simulation.upload import Uploader
from iec61499.native.resource import NativeResource

Handle = Callable[[Any], None]


@dataclass(frozen=True)
class _Frame:
    """What uploads need of the service that they belong to."""

    bus: HeadlessCell
    stopping: bool = False


class HeadlessCell:
    """The cell, which stands for the bus of a cell with all services.

    Args:
        settings: what the cell is run with; its duration says nothing.
        record: what is known of the healthy arm.
        folder: folder for the history of the settings.

    Attributes:
        time: plant time, s.
        monitor: the monitor.
        stop: the stop in force in the blocks.
    """

    def __init__(self, settings: CellSettings, record: MachineRecord, folder: Path) -> None:
        self.time = 0.0
        self.stop: Stop = "none"
        tuning = tuning_for(settings.task.boxes)
        self.monitor = Monitor(commissioned(record), MonitorSettings(tuning=tuning))
        self._told = 0
        self._pending: deque[tuple[str, Message]] = deque()
        self._handles: dict[str, Handle] = {}
        controller = EmbeddedController(settings.control, settings.blocks, sequence_of(settings))
        self._cell = Cell(settings, controller)
        self._blocks = controller.resource
        self._ahead = _compiled(self._cell, controller)
        self._verdicts = self._blocks.server(VERDICT.block)
        self._record = record
        self._checker = Checker(task=settings.task, effects=record.effects, via=sequence_of(settings).via)
        frame = cast(Service, _Frame(self))
        self._uploading: Uploading[ControlSettings, Entry, Upload] = Uploading(
            frame, ControlSettings, lambda: self.time, upload_of, lambda: None
        )
        self._uploading.find(
            lambda: Uploader(EmbeddedPort(controller), History(folder / "history.jsonl"), self._expected),
            lambda found: _tolerate(record, found, self._checker),
        )

    def desk(self, progress: Callable[[float], None], end: float) -> Desk:
        """The operator's desk at this cell."""
        return Desk(cast(Bus, self), self._look, progress, end)

    def log(self) -> Log:
        """What has happened so far, with its events in order of time."""
        log = self._cell.log.freeze()
        return replace(log, events=tuple(sorted(log.events, key=attrgetter("time"))))

    def publisher(self, topic: Topic) -> Callable[[Any], None]:
        """As of the bus; what is told is heard by the desk, and an event is in the log, too."""
        return lambda message: self._tell(topic, message)

    def subscribe(self, topic: Topic, message: type, handle: Handle) -> None:
        """As of the bus."""
        self._handles[topic.name] = handle

    def ask(self, topic: Topic, request: Any, reply: type, timeout: float = 5.0) -> Any:
        """As of the bus; what a service refuses is refused in the same way."""
        doors: dict[Topic, Callable[[Any], Any]] = {
            UPLOAD: self._upload,
            PREDICT: self._predict,
            STOP: self._stop,
            FAULT: self._inject,
        }
        return doors[topic](request)

    def _look(self) -> bool:
        """Lets time pass until there is a message, and hands over the next one; the cell never ends by itself."""
        while not self._pending:
            self._advance()
        name, message = self._pending.popleft()
        self._handles[name](message)
        return False

    def _tell(self, topic: Topic, message: Message) -> None:
        if isinstance(message, Event):
            self._cell.log.add_events([message])
        if topic.name in self._handles:
            self._pending.append((topic.name, message))

    def _advance(self) -> None:
        """Some ticks, as many as are told together over the bus, and what is said about them."""
        cell, first = self._cell, len(self._cell.log)
        run(cell.emulation, cell.controller, TOGETHER, record=cell.log.append, ahead=self._ahead)
        part = cell.log.since(first)
        self.time = float(part.columns["t"][-1])
        for event in sorted(
            [*cell.emulation.drain_events(), *cell.controller.drain_events()], key=attrgetter("time")
        ):
            self._tell(EVENTS, event)
        self._judge(part)
        self._notice(STOPS[int(self._blocks.read(STOPPED))], OWN)
        self._watch(part, first + len(part))

    def _judge(self, part: Log) -> None:
        """Lets a trial of settings have the samples."""
        measured, path = part.stack("measured"), part.stack("target")
        for time, angles, wanted in zip(part.columns["t"], measured, path, strict=True):
            if not self._uploading.on_trial:
                return
            observe = partial(_observe, time=float(time), measured=angles, path=wanted)
            self._uploading.judge(observe)

    def _watch(self, part: Log, ticks: int) -> None:
        """Lets the monitor have the samples, and tells what it says as the service does."""
        seen, done, news = stream(part), 0, False
        while done < len(seen):
            done += seen.follow(self.monitor, done, len(seen))
            noticed = self.monitor.events[self._told :]
            self._told += len(noticed)
            if noticed:
                self._tell(MONITORING, self.monitor.verdict())
                for event in of_monitor(noticed):
                    self._tell(EVENTS, event)
            news |= bool(noticed)
        if not news and ticks % VERDICT_EVERY == 0:
            self._tell(MONITORING, self.monitor.verdict())

    def _notice(self, stop: Stop, why: str) -> None:
        """Tells of a stop that is another one than before."""
        if stop != self.stop:
            self.stop = stop
            self._tell(EVENTS, Event(self.time, EventKind.STOP, f"safe stop: {stop}{why}"[:1000]))

    def _stop(self, asked: StopRequest) -> Stopped:
        (number,) = self._verdicts.exchange((ARM_STATES.index(asked.state), asked.confidence, False))
        self._notice(STOPS[int(number)], f" ({asked.who}: {asked.why})")
        return Stopped(self.time, self.stop)

    def _inject(self, asked: FaultRequest) -> Done:
        added = self._cell.emulation.inject(map(parse_fault, asked.faults))
        return Done(max(self.time, min(fault.start for fault in added)), ", ".join(map(str, added)))

    def _upload(self, asked: UploadRequest | None) -> Upload:
        if asked is None:
            return self._uploading.now()
        if asked.arm is not None:
            check_model(asked.arm)
        arm = asked.arm or self._record.arm
        return self._uploading.upload(asked, partial(self._checker.expected_tracking, arm=arm, late=asked.late))

    def _expected(self, settings: ControlSettings, in_force: ControlSettings) -> Any:
        return self._checker.expected_tracking(settings, in_force)

    def _predict(self, asked: PredictionRequest) -> Predicted:
        return predicted(self._uploading.there(), self._checker, asked, self._record.arm)


def _observe(uploader: Uploader[ControlSettings, Entry], *, time: float, measured: Any, path: Any) -> Entry | None:
    angles = uploader.settings.angles(joint_vector(measured))
    return uploader.observe(time, joint_vector(path), angles)


def _tolerate(record: MachineRecord, found: Uploader[ControlSettings, Entry], checker: Checker) -> None:
    """Demands less of an arm of which the record says that no settings have the demanded margins, as the service."""
    try:
        tolerated(record, found.settings.law, checker)
    except DtwinError:
        return


def _compiled(cell: Cell, controller: EmbeddedController) -> Callable[[int], int] | None:
    """What does ticks in machine code, if the blocks are that."""
    blocks = controller.resource
    return (
        CompiledTicks(cell.emulation, controller, blocks, cell.log).run
        if isinstance(blocks, NativeResource)
        else None
    )
