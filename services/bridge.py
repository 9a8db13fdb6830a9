"""Between the bus and the controller's TCP ports: a sample in, the application's answer out.

The controller is a 4diac FORTE or the embedded device; both tell over their management port where their blocks
listen. A backlog is skipped: only the newest sample is answered. After a gap, and when the arm had lost its voltage,
the application plans its path anew from where the arm is.
"""

from __future__ import annotations

import logging
import sys
import time
from dataclasses import dataclass
from typing import Final

from dtwin.errors import CommunicationError
from dtwin.iec61499.address import Address, parse_address, parse_block_id
from dtwin.iec61499.client import BlockingClient
from dtwin.iec61499.management_client import ManagementClient
from dtwin.live.gate import STALE
from dtwin.messages import EVENTS, PATH, SENSORS, VOLTAGES, Path
from dtwin.parameters import PERIOD, Triple
from dtwin.remote import SENSORS as SENSORS_SIGNATURE
from dtwin.remote import VOLTAGES as VOLTAGES_SIGNATURE
from dtwin.signals import Event, Sensors, Voltages
from services.service import Link, Service, main

log = logging.getLogger(__name__)

NAME: Final = "bridge"
TIMEOUT: Final = 1.0
"""s for an answer of the controller"""
RETRY: Final = 0.2
"""s between two attempts to reach the controller"""
GAP: Final = round(STALE / PERIOD)
"""ticks without an answer after which the path is planned anew"""
SERVER: Final = "EMULATOR"
HOLD: Final = "PLANNER.HOLD"
PATH_ANGLES: Final = tuple(f"PLANNER.THETA_D{joint}" for joint in (1, 2, 3))


@dataclass(frozen=True, kw_only=True)
class Options(Link):
    """Connect the bus with a controller's TCP ports."""

    controller: str = "127.0.0.1:61499"
    """HOST:PORT of the controller's device management."""
    lossless: bool = False
    """Wait for slow subscribers, as a lockstep run wants it."""

    def run(self) -> int:
        address = parse_address(self.controller)
        with Service(NAME, self) as service:
            Bridge(service, address, self.lossless).run()
        return 0


class Controller:
    """The control application on a device.

    Args:
        address: of device management.

    Raises:
        CommunicationError: the device or the application does not answer.
    """

    def __init__(self, address: Address) -> None:
        self._management = ManagementClient(address, TIMEOUT)
        try:
            self._resource = self._find_resource()
            listens = parse_block_id(self.read(f"{SERVER}.ID"))
            self._cell = BlockingClient(
                Address(address.host, listens.port), SENSORS_SIGNATURE, VOLTAGES_SIGNATURE, TIMEOUT
            )
        except CommunicationError:
            self._management.close()
            raise

    def close(self) -> None:
        self._cell.close()
        self._management.close()

    def answer(self, sensors: Sensors) -> Voltages:
        """The application's answer to a sample.

        Raises:
            CommunicationError: it is late, lost or of another form.
        """
        sample = (*sensors.theta, sensors.gripper, sensors.box_present, sensors.box_colour)
        v_1, v_2, v_3, v_gripper, gripped = self._cell.exchange(sample)
        return Voltages(sensors.sequence, sensors.time, (v_1, v_2, v_3, v_gripper), gripped)

    def restart(self, sensors: Sensors) -> None:
        """Lets the application plan its path from a sample, at rest, without integrals of the past.

        HOLD does that at every sample; the second one tells it that the arm is at rest.
        """
        self.write(HOLD, "TRUE")
        self.answer(sensors)
        self.answer(sensors)
        self.write(HOLD, "FALSE")

    def path(self) -> Triple:
        """The path's angles in the last answer, rad."""
        theta_1, theta_2, theta_3 = (float(self.read(name)) for name in PATH_ANGLES)
        return theta_1, theta_2, theta_3

    def read(self, name: str) -> str:
        return self._management.read(self._resource, name)

    def write(self, name: str, literal: str) -> None:
        self._management.write(self._resource, name, literal)

    def _find_resource(self) -> str:
        for resource in self._management.blocks(""):
            if any(block.name == SERVER for block in self._management.blocks(resource.name)):
                return resource.name
        raise CommunicationError(f"{self._management.address}: no resource has a block {SERVER}: deploy to it first")


class Bridge:
    """Answers samples while there is a controller, and looks for one while there is none."""

    def __init__(self, service: Service, address: Address, lossless: bool) -> None:
        bus = service.bus
        self._service = service
        self._address = address
        self._controller: Controller | None = None
        self._try_at = 0.0
        self._last: Voltages | None = None
        self._restart = False
        self._answered = 0
        self._skipped = 0
        self._publish = bus.publisher(VOLTAGES, lossless=lossless)
        self._publish_path = bus.publisher(PATH, lossless=lossless)
        bus.subscribe(SENSORS, Sensors, service.inbox.put)
        bus.subscribe(EVENTS, Event, self._note)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        while self._controller is None and not service.stopping:
            self._connect()
            service.next(0.0 if self._controller else RETRY)
        service.ready()
        while not service.stopping:
            sensors = service.next(RETRY)
            if sensors is not None:
                self._serve(self._newest(sensors))
            elif self._controller is None:
                self._connect()
            if service.report_due():
                self._report()
        if self._controller is not None:
            self._controller.close()

    def _newest(self, sensors: Sensors) -> Sensors:
        while (later := self._service.next(0.0)) is not None:
            self._skipped += 1
            sensors = later
        return sensors

    def _serve(self, sensors: Sensors) -> None:
        last = self._last
        if last is not None and (sensors.sequence, sensors.time) == (last.sequence, last.time):
            self._publish(last)
            return
        controller = self._connect()
        if controller is None:
            return
        try:
            if last is not None and not 0 < sensors.sequence - last.sequence <= GAP:
                self._restart = True
            if self._restart:
                controller.restart(sensors)
                self._restart = False
                log.warning("path planned anew at %.2f s after a gap", sensors.time)
            command = controller.answer(sensors)
            self._publish(command)
            if self._publish_path.wanted:
                self._publish_path(Path(sensors.sequence, sensors.time, controller.path()))
        except CommunicationError as error:
            log.warning("%s", error)
            controller.close()
            self._controller = None
            self._restart = True
            return
        self._last = command
        self._answered += 1

    def _connect(self) -> Controller | None:
        now = time.monotonic()
        if self._controller is None and now >= self._try_at:
            self._try_at = now + RETRY
            try:
                self._controller = Controller(self._address)
            except CommunicationError as error:
                log.warning("%s", error)
        return self._controller

    def _note(self, event: Event) -> None:
        if event.kind == "safe":
            self._restart = True

    def _report(self) -> None:
        last = self._last
        self._service.report(
            "running" if self._controller is not None else "waiting",
            self._answered,
            time=0.0 if last is None else last.time,
            late_ticks=self._skipped,
        )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
