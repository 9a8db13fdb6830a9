"""Services of a cell that answer the operator at once, without any bus."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import msgspec

from dtwin.bus.messages import (
    DECIDE,
    EVENTS,
    IDENTIFICATION,
    IDENTIFY,
    LATCH,
    MONITORING,
    PREDICT,
    STOP,
    UPLOAD,
    LatchRequest,
    LatchState,
    StopRequest,
    StopState,
)
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.bus.twin_messages import (
    UNITS,
    Estimated,
    IdentificationRequest,
    IdentificationState,
    MonitoredUnit,
    MonitoringVerdict,
    Predicted,
    PredictedMotion,
    PredictionRequest,
    Upload,
    UploadRequest,
)
from dtwin.controller.settings import USUAL_GAINS, ControlSettings
from dtwin.errors import CommunicationError
from dtwin.identification.machine.record import MachineRecord
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.parameters import ArmParameters
from dtwin.recovery.desk import Desk
from dtwin.recovery.measures import Measures
from dtwin.recovery.operator import Operator
from dtwin.settings.change import Change, asked_of
from dtwin.signals import Event
from dtwin.simulation.checks import MOTIONS

HEALTHY = ArmParameters()
TICK = 0.5
"""s of plant time between two verdicts"""
TRIAL = 10.0
"""s"""


class FakeCell:
    """Services of a cell as the operator sees them: plant time passes whenever it looks for a message.

    Attributes:
        found: findings that stand from a plant time (s) on, by what they name: time, size and deviation.
        noticed: when findings were noticed, if it was not when they began, s.
        confidence: confidence in what is found.
        follows: what findings may be consequences of, by what they name.
        open: names of what the monitor is still finding out.
        refits: what identification will find, by parameter.
        changing: changes what is found, whenever time has passed.
        deaf: number of requests for a stop that nobody answers.
        worse: gives how far a motion is from its path, relative to the healthy arm, by the request.
        off: gives the largest distance of a joint from its path, rad, by the request.
        roll_back: whether settings on trial are taken back.
        uploads, stops, told: what the operator asked for and said.
        latched: what it asked the emulator's latch for, and when.
    """

    def __init__(self) -> None:
        self.time = 0.0
        self.found: dict[str, tuple[float, float, float]] = {}
        self.noticed: dict[str, float] = {}
        self.confidence = 1.0
        self.follows: dict[str, str] = {}
        self.open: list[str] = []
        self.refits: dict[str, float] = {}
        self.changing: Callable[[], None] = lambda: None
        self.deaf = 0
        self.worse: Callable[[PredictionRequest], float] = lambda request: 1.0
        self.off: Callable[[PredictionRequest], float] = lambda request: 0.0
        self.roll_back = False
        self.refuse = ""
        self.uploads: list[UploadRequest] = []
        self.identified: list[IdentificationRequest] = []
        self.stops: list[StopRequest] = []
        self.latched: list[tuple[float, str]] = []
        self.told: list[str] = []
        self.events: list[Event] = []
        self._trial = 0.0
        self._handlers: dict[str, Callable[[Any], None]] = {}
        self._before = self._now = Upload(
            1, 0.0, "start", "", False, USUAL_GAINS["cascade"], 2.0, "cascade", HEALTHY, payload=0.2
        )

    def over(self) -> bool:
        """Lets time pass, and tells what there is at that time."""
        self.time += TICK
        self.changing()
        if self._now.on_trial and self.time >= self._trial + TRIAL:
            self._end_trial()
        while self.events and self.events[0].time <= self.time:
            self._handlers[EVENTS.name](self.events.pop(0))
        units, findings = {unit: MonitoredUnit("nominal") for unit in UNITS}, list[MonitoredUnit]()
        for name, (since, size, deviation) in self.found.items():
            if since <= self.time:
                fault = parse_fault_id(name)
                noticed = self.noticed.get(name, since)
                how = (size, deviation, self.confidence, since, noticed, True, name)
                unit = MonitoredUnit("failed", fault.about.cause, name, *how, follows=self.follows.get(name, ""))
                units[UNITS[fault.joint - 1]] = unit
                findings.append(unit)
        findings += [MonitoredUnit("may be degrading", parameter=name) for name in self.open]
        self._handlers[MONITORING.name](MonitoringVerdict(self.time, units, (), (), 0, 0, tuple(findings[::-1])))
        return False

    def publisher(self, topic: Topic) -> Callable[[Event], None]:
        assert topic == EVENTS
        return lambda event: self.told.append(event.text)

    def subscribe(self, topic: Topic, message: type, handle: Callable[[Any], None]) -> None:
        self._handlers[topic.name] = handle

    def ask(self, topic: Topic, request: Any, reply: type, timeout: float = 5.0) -> Any:
        answers: dict[Topic, Callable[[Any], Any]] = {
            UPLOAD: self._upload,
            PREDICT: self._predict,
            IDENTIFY: self._identify,
            DECIDE: lambda request: IdentificationState("accepted"),
            STOP: self._stop,
            LATCH: self._latch,
        }
        return answers[topic](request)

    def _upload(self, request: UploadRequest | None) -> Upload:
        if request is not None:
            assert not self._now.on_trial
            assert request.based_on == self._now.version
            self.uploads.append(request)
            asked = asked_of(ControlSettings, request)
            changes = Change.of(ControlSettings, asked).values  # as the service, of one kind at a time
            self._before, self._trial = self._now, self.time
            self._now = msgspec.structs.replace(
                self._now, version=self._now.version + 1, time=self.time, action="upload", on_trial=True, **changes
            )
        return self._now

    def _end_trial(self) -> None:
        if self.roll_back:
            version = self._now.version + 1
            self._now = msgspec.structs.replace(self._before, version=version, action="roll back", text="worse")
        else:
            self._now = msgspec.structs.replace(self._now, action="confirm", on_trial=False)

    def _predict(self, request: PredictionRequest) -> Predicted:
        rms, nothing = (1e-3 * self.worse(request), 0.0, 0.0), (0.0, 0.0, 0.0)
        off = (self.off(request), 0.0, 0.0)
        return Predicted(1, tuple(PredictedMotion(*motion, rms, off, nothing, 0.0) for motion in MOTIONS))

    def _identify(self, request: IdentificationRequest) -> IdentificationState:
        self.identified.append(request)
        found = {name: Estimated(value, 1e-4) for name, value in self.refits.items()}
        phase = (
            IdentificationState("refused", self.refuse)
            if self.refuse
            else IdentificationState("proposed", parameters=found)
        )
        self._handlers[IDENTIFICATION.name](phase)
        return IdentificationState("measuring")

    def _latch(self, request: LatchRequest) -> LatchState:
        self.latched.append((self.time, request.stop))
        return LatchState(self.time, len(self.latched), request.stop)

    def _stop(self, request: StopRequest) -> StopState:
        if self.deaf:
            self.deaf -= 1
            raise CommunicationError("no answer")
        self.stops.append(request)
        return StopState(self.time, "torque off" if request.state == "angles unknown" else "braking")


def watched(cell: FakeCell, record: MachineRecord | None = None) -> Operator:
    """The operator after 60 s at a cell; the upload of the healthy arm's model is left out of its list."""
    return attended(cell, record)[0]


def attended(cell: FakeCell, record: MachineRecord | None = None) -> tuple[Operator, Desk]:
    """The same with its desk; it ends earlier once it has stopped the arm."""
    desk = Desk(cast(Bus, cell), cell.over, lambda time: None, 60.0)
    measures = Measures(desk, HEALTHY, record)
    measures.put_into_force()
    cell.uploads.clear()
    operator = Operator(desk, measures)
    operator.watch()
    return operator, desk


def measures_of(operator: Operator) -> list[tuple[str, tuple[str, ...]]]:
    return [(step.measure, step.parameters) for step in operator.steps]
