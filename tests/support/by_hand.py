"""Services without a supervisor: started one by one, without a key, and seen from outside."""

import os
import subprocess
import sys

from dtwin.bus.messages import EVENTS, SENSORS, STATUS, Status
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.parameters import ROOT
from dtwin.signals import Event, Sensors
from tests.support.ports import free_port
from tests.support.waiting import until

PATIENCE = 120.0
"""Deadline of every wait, s."""
FAR = 10**12
"""Number of a sample from which on it is forged."""


class ByHand:
    """A bus and services on it that were started by hand, so without a key.

    Attributes:
        meet: where they meet.
        bus: session of the test.
        samples: samples that were heard, without those far ahead.
        events: events that were heard.
        statuses: last statuses, by the names of the services.
    """

    def __init__(self) -> None:
        self.meet = f"tcp/127.0.0.1:{free_port()}"
        self.bus = Bus(open_peer(self.meet))
        self.samples: list[Sensors] = []
        self.events: list[Event] = []
        self.statuses: dict[str, Status] = {}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self.bus.subscribe(SENSORS, Sensors, self._on_sample)
        self.bus.subscribe(EVENTS, Event, self.events.append)
        self.bus.subscribe(STATUS, Status, self._note)

    def start(self, name: str, *options: str) -> None:
        command = [sys.executable, "-m", f"services.{name}", "--meet", self.meet, *options]
        self._processes[name] = subprocess.Popen(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)})

    def kill(self, name: str) -> None:
        process = self._processes.pop(name)
        process.kill()
        process.wait()

    def close(self) -> None:
        for name in list(self._processes):
            self.kill(name)
        self.bus.close()

    @property
    def last(self) -> Sensors:
        return self.samples[-1]

    def refused(self, name: str, reason: str) -> int:
        return self.statuses[name].refused.get(reason, 0) if name in self.statuses else 0

    def goes_on(self) -> None:
        at = self.last.sequence
        until(lambda: self.last.sequence > at + 200, "the cell goes on", PATIENCE)

    def _on_sample(self, sample: Sensors) -> None:
        if sample.sequence < FAR:
            self.samples.append(sample)

    def _note(self, status: Status) -> None:
        self.statuses[status.service] = status
