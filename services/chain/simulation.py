"""Gives the running blocks of an arm of n joints another model or tuning: checked on the twin, on trial, versioned.

What the blocks have forgotten, because others are in their place, is given to them again.
"""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from dtwin.arm.model import ArmModel, ArmSettings
from dtwin.bus.chain.messages import (
    JointAdjustment,
    JointModel,
    JointPredicted,
    JointQuestion,
    JointTicks,
    JointUpload,
    JointUploadRequest,
)
from dtwin.bus.messages import ADJUSTED, ARM_PREDICT, ARM_ROLL_BACK, ARM_UPLOAD, EVENTS, JOINT_TICKS, MODEL
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import RollBackRequest
from dtwin.errors import CommunicationError, DtwinError, ParameterError
from dtwin.run.chain import ChainSettings
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.parts.readiness.preparation import prepare
from dtwin.services.service import Link, Service, main
from dtwin.signals import Event, EventKind
from dtwin.simulation.chain.checks import as_before, expected_tracking
from dtwin.simulation.chain.history import ArmEntry, ArmHistory
from dtwin.simulation.chain.predicting import Predicting
from dtwin.simulation.chain.upload import ArmUploads
from dtwin.simulation.history import HISTORY

log = logging.getLogger(__name__)

NAME: Final = "simulation"
WAIT: Final = 0.2
"""Longest wait for a tick before the status is looked after, s."""
PATIENCE: Final = 10.0
"""Longest wait of an upload until an arm that has just begun was measured, s."""


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions, Link):
    """Upload models and tunings to the blocks of a running arm."""

    history: Path = HISTORY
    """File for the history of the settings."""

    def run(self) -> int:
        settings = self.settings()
        with Service(NAME, self) as service:
            Uploading(service, settings, ArmHistory(self.history)).run()
        return 0


class BridgePort:
    """The running blocks as uploads see them: through the bridge, which alone talks to them.

    Args:
        bus: session of this service.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus

    def send(self, who: str, why: str, settings: ArmSettings) -> None:
        """Raises CommunicationError when the bridge does not answer, or refuses."""
        self._bus.ask(MODEL, JointModel(who, why[:1000], settings.model, settings.tuning), JointModel)

    def read_back(self) -> ArmSettings:
        """Raises CommunicationError when the bridge does not answer."""
        found = self._bus.ask(MODEL, None, JointModel)
        return ArmSettings(found.model, found.tuning)


class _Mark:
    """Stands in the inbox behind the ticks that came before a change."""


class Uploading:
    """One upload after another.

    Args:
        service: frame of the service.
        settings: run of the arm.
        history: history of the settings.
    """

    def __init__(self, service: Service, settings: ChainSettings, history: ArmHistory) -> None:
        self._service = service
        self._settings = settings
        self._history = history
        self._uploads: ArmUploads | None = None
        self._lock = threading.Lock()
        self._offset = (0.0,) * len(settings.arm)
        self._time = 0.0
        self._done = 0
        self._marks = 0
        bus = service.bus
        self._publish: Callable[[Event], None] = bus.publisher(EVENTS)
        bus.subscribe(JOINT_TICKS, JointTicks, service.inbox.put)
        bus.subscribe(ADJUSTED, JointAdjustment, service.inbox.put)
        bus.answer(ARM_UPLOAD, JointUploadRequest, self._answer, self._now)
        bus.answer(ARM_ROLL_BACK, RollBackRequest, self._roll_back, self._now)
        self._predicting = Predicting(settings)
        bus.answer(ARM_PREDICT, JointQuestion, self._predict, lambda: self._predict(JointQuestion()))

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        prepare(service, [("the checks of settings", partial(self._expected, self._sheet()))])
        while self._uploads is None and not service.stopping:
            try:
                self._uploads = ArmUploads(BridgePort(service.bus), self._history, self._expected)
            except CommunicationError as error:
                log.info("%s", error)
                service.next(WAIT)
            if service.report_due():
                service.report("waiting")
        service.ready()
        while not service.stopping:
            item = service.next(WAIT)
            if isinstance(item, JointTicks):
                self._judge(item)
            elif isinstance(item, JointAdjustment):
                self._offset = item.offset
            elif isinstance(item, _Mark):
                with self._lock:
                    self._marks -= 1
            if service.report_due():
                self._look_again()
                service.report("running", self._done, time=self._time)

    def _predict(self, question: JointQuestion) -> JointPredicted:
        """Answers on a thread of its own, beside everything else: nothing is changed."""
        last = self._there().last
        return self._predicting.answer(question, last.version, last.settings)

    def _expected(self, wished: ArmSettings) -> tuple[float, ...]:
        """The distances from the path that are expected with other settings.

        Raises:
            ParameterError: they must not be uploaded.
        """
        expected, uploads = expected_tracking(self._settings, wished), self._uploads
        measured = self._predicting.measured
        if uploads is None or measured is None or wished.model != uploads.settings.model:
            return expected
        return as_before(expected, expected_tracking(self._settings, uploads.settings), measured)

    def _sheet(self) -> ArmSettings:
        return ArmSettings(ArmModel.of(self._settings.arm), self._settings.control.tuning)

    def _judge(self, passed: JointTicks) -> None:
        self._predicting.receive(passed)
        self._time = passed.ticks[-1].sensors.time
        for tick in passed.ticks:
            sensors = tick.sensors
            if len(sensors.theta) != len(self._offset):
                return
            measured = tuple(a - b for a, b in zip(sensors.theta, self._offset, strict=True))
            entry = None
            with self._lock:
                if self._uploads is not None and self._uploads.on_trial and not self._marks:
                    try:
                        if tick.acted.sequence == sensors.sequence:
                            entry = self._uploads.observe(sensors.time, tick.acted.target, measured)
                        else:  # a command for an earlier sample acts on
                            entry = self._uploads.miss(sensors.time)
                    except DtwinError as error:
                        log.error("%s", error)
            if entry is not None:
                self._tell(entry)

    def _look_again(self) -> None:
        with self._lock:
            try:
                if self._uploads is not None and self._uploads.look_again():
                    text = f"the blocks have got version {self._uploads.version} of their settings again"
                    self._publish(Event(self._time, EventKind.RESTORED, text))
            except DtwinError as error:
                log.warning("%s", error)

    def _now(self) -> JointUpload:
        return _message(self._there())

    def _answer(self, asked: JointUploadRequest) -> JointUpload:
        """Answers on a thread of its own: a check may take longer than a tick."""
        uploads = self._there()
        if (asked.model is None and asked.tuning is None) == (asked.version is None):
            raise ParameterError("upload: expected either a model, a tuning or both, or the version of earlier ones")
        if asked.model is None:  # how far the arm is off its path now says what to expect of it under other gains
            self._predicting.await_measured(PATIENCE)
        with self._lock:
            now = uploads.settings
            wished = ArmSettings(asked.model or now.model, asked.tuning or now.tuning)
            if asked.version is not None:
                wished = uploads.earlier(asked.version)
            return self._changed(lambda: uploads.upload(asked.who, asked.why, asked.based_on, wished, self._time))

    def _roll_back(self, asked: RollBackRequest) -> JointUpload:
        uploads = self._there()
        with self._lock:
            return self._changed(lambda: uploads.roll_back(asked.who, asked.why, self._time))

    def _changed(self, action: Callable[[], ArmEntry]) -> JointUpload:
        uploads = self._there()
        before = uploads.last
        try:
            action()
        finally:
            self._marks += 1  # what waits in the inbox is of the settings before
            self._service.inbox.put(_Mark())
            if uploads.last is not before:
                self._tell(uploads.last)
        return _message(uploads)

    def _there(self) -> ArmUploads:
        if self._uploads is None:
            raise CommunicationError("the simulation service is not ready yet: `dtwin status` shows what it does")
        return self._uploads

    def _tell(self, entry: ArmEntry) -> None:
        self._done += 1
        text = f"version {entry.version} of the settings: {entry.text or entry.why}"
        log.info("%s: %s", entry.action, text)
        self._publish(Event(entry.time, EventKind(entry.action), text[:1000]))


def _message(uploads: ArmUploads) -> JointUpload:
    last = uploads.last
    text = last.text or last.why
    return JointUpload(
        last.version,
        last.time,
        last.action,
        text,
        uploads.on_trial,
        last.model,
        last.predicted,
        last.measured,
        last.tuning,
    )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
