"""The operator who puts a running cell right again, with nothing but what its services say and offer on the bus.

Friction of a joint grows; monitoring notices and names it; identification refits the model from the arm's motion;
simulation says what the model changes, checks it, uploads it and watches the trial; then settings are sought under
which the arm as it is now tracks as well as the healthy one did.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from typing import Any, Final

import msgspec
import numpy as np

from dtwin.bus.messages import (
    DECIDE,
    EVENTS,
    FAULT,
    IDENTIFICATION,
    IDENTIFY,
    MONITORING,
    PREDICT,
    UPLOAD,
    Done,
    FaultRequest,
)
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import (
    IdentificationDecision,
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
from dtwin.errors import CommunicationError
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, Gains, Triple, symbol_of
from dtwin.signals import Event

LIMIT: Final = 60.0
"""s of plant time after the fault in which the arm has to have recovered"""
LONGEST: Final = 600.0
"""s of plant time in which the cell has to have shown what it can do while it is healthy"""
DELIVERIES: Final = 3
"""boxes that the healthy arm delivers before the fault"""
BOXES: Final = (0.2, 0.21)
"""kg, the usual box and the heaviest"""
SLOWER: Final = (1.0, 1.1, 1.25, 1.5)
"""factors on the target time that are tried, in this order"""
STIFFER: Final = (1.0, 1.15, 1.3, 1.5)
"""factors on Kp and Ki that are tried for each; beyond the last, encoder noise gets the better of the gain"""
NAME: Final = "operator"
"""name of the operator in the history and among the events"""
_LOOK: Final = 0.1
"""s"""


@dataclass(frozen=True, slots=True)
class Story:
    """What the operator saw and did; times are plant time, s, None for what did not happen.

    Attributes:
        fault: when the friction grew.
        started: when the model of the healthy arm was in force.
        finding: what the monitor found.
        refitted: the parameter that the finding names, identified anew, SI units.
        uploaded: when the new model was acknowledged.
        trouble: why not all was done, "" if it was.
    """

    fault: float | None = None
    started: float | None = None
    finding: MonitoredUnit | None = None
    refitted: float | None = None
    uploaded: float | None = None
    trouble: str = ""


class _Late(Exception):
    """The time to recover in has passed, or the cell has ended."""


class Operator:
    """Makes a fault, and puts it right.

    Args:
        bus: the bus of the cell, at which all the services are.
        healthy: the arm as it was identified.
        over: whether the cell has ended, asked all the time.
        progress: told the plant time, s.
    """

    def __init__(
        self, bus: Bus, healthy: ArmParameters, over: Callable[[], bool], progress: Callable[[float], None]
    ) -> None:
        self._bus = bus
        self._healthy = healthy
        self._over = over
        self._progress = progress
        self._inbox: SimpleQueue[Any] = SimpleQueue()
        self._end = LONGEST
        self._time = 0.0
        self._story = Story()
        self._tell = bus.publisher(EVENTS)
        bus.subscribe(EVENTS, Event, self._inbox.put)
        bus.subscribe(MONITORING, MonitoringVerdict, self._inbox.put)
        bus.subscribe(IDENTIFICATION, IdentificationState, self._inbox.put)

    def work(self, fault: str) -> Story:
        """Lets the cell work, makes the fault (such as D2*=1.7), deals with it, and waits until the time is over."""
        try:
            reference = self._begin()
            self._break(fault)
            arm = self._refit(self._notice())
            self._upload_model(arm)
            self._retune(arm, reference)
        except _Late as late:
            self._note(trouble=str(late))
        except CommunicationError as error:
            self._note(trouble=str(error))
            self._say(f"cannot go on: {error}")
        if self._story.fault is not None:
            with contextlib.suppress(_Late):
                for _ in self._messages():
                    pass
        return self._story

    def _begin(self) -> list[PredictedMotion]:
        """Puts the model of the healthy arm into force, and asks what to expect of it."""
        answer = self._upload("the model identified of the healthy arm", model=self._healthy)
        self._note(started=answer.time)
        self._await_trial()
        return self._expect(PredictionRequest(arm=self._healthy))

    def _break(self, fault: str) -> None:
        """Once the healthy arm has delivered some boxes, lets the friction grow as it sets out with the next one."""
        deliveries = 0
        while deliveries < DELIVERIES:
            self._await_event("delivered")
            deliveries += 1
        self._await_event("picked")
        done = self._bus.ask(FAULT, FaultRequest((f"{fault}@0",)), Done)
        self._end = done.time + LIMIT
        self._note(fault=done.time)

    def _notice(self) -> MonitoredUnit:
        for message in self._messages():
            if isinstance(message, MonitoringVerdict):
                settled = [unit for unit in message.units.values() if unit.settled]
                if settled:
                    self._note(finding=settled[0])
                    return settled[0]
        raise AssertionError("the messages only end with an exception")

    def _refit(self, finding: MonitoredUnit) -> ArmParameters:
        """The arm with what has changed identified from its empty motions since."""
        name = finding.parameter
        if name not in PARAMETER_NAMES:
            raise CommunicationError(f"monitoring names {name}: expected a parameter of the arm to identify")
        symbol = symbol_of(name)
        request = IdentificationRequest(symbol, source="motion", since=finding.detected, anew=name)
        self._say(f"asks identification for {name} from the motions since {finding.detected:.2f} s")
        self._bus.ask(IDENTIFY, request, IdentificationState)
        state = self._await_model()
        self._bus.ask(DECIDE, IdentificationDecision(True, "recovery"), IdentificationState)
        alike = [key for key in PARAMETER_NAMES if key in state.parameters and symbol_of(key) == symbol]
        found = {key: state.parameters[key].value for key in alike}
        arm = self._healthy.with_values(found)
        self._note(refitted=arm.get(name))
        self._say(f"accepts the model: {name} is {arm.get(name):.4f}, was {self._healthy.get(name):.4f}")
        return arm

    def _upload_model(self, arm: ArmParameters) -> None:
        now, then = (
            float(np.sqrt(np.mean([np.square(motion.rms) for motion in self._expect(request)])))
            for request in (PredictionRequest(arm=arm), PredictionRequest(model=arm))
        )
        self._say(f"simulation expects {1e3 * then:.2f} mrad rms from the path in place of {1e3 * now:.2f}")
        self._note(uploaded=self._upload("the arm has changed", model=arm).time)

    def _retune(self, arm: ArmParameters, reference: Sequence[PredictedMotion]) -> None:
        """Looks for settings that make up for what the model alone does not, while the model is on trial."""
        current = self._bus.ask(UPLOAD, None, Upload)
        gains, target_time, ratio = self._search(current, reference)
        self._await_trial()
        expected = f"at most {100 * ratio:.0f} % of the healthy arm's distance from the path expected"
        if (gains, target_time) == (current.gains, current.target_time):
            self._say(f"gains and target time can stay: {expected}")
            return
        stiffer, slower = gains.kp[0] / current.gains.kp[0], target_time / current.target_time
        why = f"Kp and Ki times {stiffer:g}, target time times {slower:g}: {expected}"
        self._upload(why, gains=gains, target_time=target_time, arm=arm)
        self._await_trial()

    def _search(self, current: Upload, reference: Sequence[PredictedMotion]) -> tuple[Gains, float, float]:
        """Gains, target time (s) and how far the worst motion is from its path, relative to the healthy arm.

        The first that is no worse than the healthy arm in any motion, from the least change on; else the best.
        """
        found = []
        for slower in SLOWER:
            for stiffer in STIFFER:
                gains = replace(
                    current.gains,
                    kp=_times(stiffer, current.gains.kp),
                    ki=_times(stiffer, current.gains.ki),
                )
                expected = self._expect(PredictionRequest(gains, slower * current.target_time))
                ratio = max(_length(m.rms) / _length(r.rms) for m, r in zip(expected, reference, strict=True))
                if ratio <= 1.0:
                    return gains, slower * current.target_time, ratio
                found.append((gains, slower * current.target_time, ratio))
        return min(found, key=lambda tried: tried[2])

    def _expect(self, request: PredictionRequest) -> list[PredictedMotion]:
        """What simulation expects of all motions, with boxes as they are usual and with the heaviest."""
        return [
            motion
            for box in BOXES
            for motion in self._bus.ask(PREDICT, msgspec.structs.replace(request, box=box), Predicted).motions
        ]

    def _upload(
        self,
        why: str,
        gains: Gains | None = None,
        target_time: float | None = None,
        model: ArmParameters | None = None,
        arm: ArmParameters | None = None,
    ) -> Upload:
        version = self._bus.ask(UPLOAD, None, Upload).version
        request = UploadRequest(NAME, why, version, gains=gains, target_time=target_time, model=model, arm=arm)
        return self._bus.ask(UPLOAD, request, Upload)

    def _await_trial(self) -> None:
        """Until the settings in force are on trial no longer.

        Raises:
            CommunicationError: they were taken back.
        """
        while (now := self._bus.ask(UPLOAD, None, Upload)).on_trial:
            next(self._messages())
        if now.action == "roll back":
            raise CommunicationError(f"version {now.version - 1} of the settings was taken back: {now.text}")

    def _await_event(self, kind: str) -> Event:
        return next(m for m in self._messages() if isinstance(m, Event) and m.kind == kind)

    def _await_model(self) -> IdentificationState:
        for message in self._messages():
            if isinstance(message, IdentificationState):
                if message.phase == "proposed":
                    return message
                if message.phase == "refused":
                    raise CommunicationError(f"identification: {message.text}")
        raise AssertionError("the messages only end with an exception")

    def _messages(self) -> Iterator[Any]:
        """What the services say, until the time is over.

        Raises:
            _Late: it is.
        """
        while True:
            if self._over():
                raise _Late("the cell has ended")
            if self._time >= self._end:
                raise _Late(f"not done by {self._end:g} s")
            with contextlib.suppress(Empty):
                message = self._inbox.get(timeout=_LOOK)
                if isinstance(message, Event | MonitoringVerdict):
                    self._time = max(self._time, message.time)
                    self._progress(self._time)
                yield message

    def _say(self, text: str) -> None:
        self._tell(Event(self._time, NAME, text))

    def _note(self, **changes: Any) -> None:
        self._story = replace(self._story, **changes)


def _times(factor: float, gains: Triple) -> Triple:
    first, second, third = gains
    return factor * first, factor * second, factor * third


def _length(values: Triple) -> float:
    return math.sqrt(sum(value * value for value in values))
