"""Uploads settings to the running controller: checks them on the twin, watches the trial, keeps the history.

They go through the blocks of SYSTEM_SIMULATION on the device, a 4diac FORTE or the embedded runtime. The samples
and the path that a trial is judged by come over the bus. A trial that the end of this service cut short is taken up
again.
"""

from __future__ import annotations

import logging
import sys
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from dtwin.application import settings_at
from dtwin.control import ControlSettings, Law
from dtwin.errors import CommunicationError, DtwinError
from dtwin.iec61499.address import Address, parse_address
from dtwin.messages import EVENTS, PATH, SENSORS, UPLOAD, Upload, UploadRequest
from dtwin.messages import Path as PathAngles
from dtwin.parameters import ArmParameters, Gains
from dtwin.signals import Event, Sensors
from dtwin.simulation.checks import Checker
from dtwin.simulation.history import HISTORY, Entry, History
from dtwin.simulation.upload import Proposal, Uploader
from services.service import Link, Service, main

log = logging.getLogger(__name__)

NAME: Final = "simulation"
RETRY: Final = 0.2
"""s between two attempts to reach the controller"""
_KEPT: Final = 100
"""samples that may wait for their path"""


@dataclass(frozen=True, kw_only=True)
class Options(Link):
    """Upload settings to the controller of a running cell."""

    controller: str = "127.0.0.1:61499"
    """HOST:PORT of the controller's device management."""
    history: Path = HISTORY
    """File for the history of the settings; it says what was in force when the service starts again."""
    law: Law = "default"
    """Control law that the controller was started with."""
    box: float = 0.2
    """Mass of a box that the controller counts on, kg."""

    def run(self) -> int:
        address = parse_address(self.controller)
        port = DevicePort(address, ControlSettings(law=self.law, payload=self.box))
        checker = Checker()
        with Service(NAME, self) as service:
            Simulation(service, port, History(self.history), checker).run()
        return 0


class DevicePort:
    """A controller on a device, as uploads see it.

    Args:
        address: of device management.
        started: settings that the device was started with; law and box stay what they are there.
    """

    def __init__(self, address: Address, started: ControlSettings) -> None:
        self._address = address
        self._started = started

    def send_gains(self, gains: Gains, target_time: float) -> None:
        """Raises CommunicationError when the device does not take them over."""
        with settings_at(self._address) as settings:
            settings.set_tuning(gains, target_time)

    def send_model(self, model: ArmParameters) -> None:
        """Raises CommunicationError when the device does not take it over."""
        with settings_at(self._address) as settings:
            settings.set_model(model)

    def read_back(self) -> ControlSettings:
        """Raises CommunicationError when the device does not answer."""
        with settings_at(self._address) as settings:
            return replace(
                self._started, gains=settings.gains(), target_time=settings.target_time(), model=settings.model()
            )


class Simulation:
    """One upload after another."""

    def __init__(self, service: Service, port: DevicePort, history: History, checker: Checker) -> None:
        self._service = service
        self._port = port
        self._history = history
        self._checker = checker
        self._uploader: Uploader | None = None
        self._lock = threading.Lock()
        self._samples: dict[int, Sensors] = {}
        self._time = 0.0
        self._done = 0
        bus = service.bus
        self._publish = bus.publisher(EVENTS)
        bus.subscribe(SENSORS, Sensors, service.inbox.put)
        bus.subscribe(PATH, PathAngles, service.inbox.put)
        bus.answer(UPLOAD, UploadRequest, self._answer)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        while self._uploader is None and not service.stopping:
            try:
                self._uploader = Uploader(self._port, self._history, self._checker)
            except CommunicationError as error:
                log.info("%s", error)
                service.next(RETRY)
            if service.report_due():
                service.report("waiting")
        service.ready()
        while not service.stopping:
            item = service.next(RETRY)
            if isinstance(item, Sensors):
                self._time = item.time
                self._keep(item)
            elif isinstance(item, PathAngles):
                self._judge(item)
            if service.report_due():
                service.report("running", self._done, time=self._time)

    def _keep(self, sensors: Sensors) -> None:
        self._samples[sensors.sequence] = sensors
        while len(self._samples) > _KEPT:
            del self._samples[next(iter(self._samples))]

    def _judge(self, path: PathAngles) -> None:
        sensors = self._samples.pop(path.sequence, None)
        uploader = self._uploader
        if sensors is None or uploader is None or uploader.trial is None:
            return
        with self._lock:
            try:
                entry = uploader.observe(sensors.time, path.theta, sensors.theta)
            except DtwinError as error:
                log.error("%s", error)
                return
        if entry is not None:
            self._tell(entry)

    def _answer(self, request: UploadRequest | None) -> Upload:
        """Answers on a thread of its own: a check may take longer than a tick."""
        uploader = self._uploader
        if uploader is None:
            raise CommunicationError("the controller has not answered yet; try again")
        with self._lock:
            if request is not None:
                uploader.look_again(self._time)
                proposal = Proposal(
                    request.who, request.why, request.based_on, request.gains, request.target_time, request.model
                )
                try:
                    self._tell(uploader.upload(proposal, self._time, request.arm))
                except DtwinError:
                    self._tell(uploader.last)
                    raise
            return _upload(uploader)

    def _tell(self, entry: Entry) -> None:
        self._done += 1
        text = f"version {entry.version} of the settings, {entry.kind}: {entry.text or entry.why}"
        log.info("%s: %s", entry.action, text)
        self._publish(Event(entry.time, entry.action, text[:1000]))


def _upload(uploader: Uploader) -> Upload:
    last, settings = uploader.last, uploader.settings
    return Upload(
        last.version,
        last.time,
        last.action,
        last.text,
        uploader.trial is not None,
        settings.gains,
        settings.target_time,
        settings.model,
        last.predicted,
    )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
