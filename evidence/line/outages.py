"""A line in processes on two hosts: twins are ended and frozen at random, and one host is cut off; what goes on."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Final, Literal

import msgspec
import numpy as np

from dtwin.bus.line.messages import LineState
from dtwin.bus.line.plant import PlantState
from dtwin.bus.line.topics import LINE_STATE, PLANT_STATE
from dtwin.bus.messages import STATUS, Status
from dtwin.bus.session import Bus
from dtwin.bus.signature import new_key
from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from dtwin.errors import CommunicationError, DtwinError
from evidence.experiment import ExperimentCommand
from evidence.line.network import Host, host, joined, router
from evidence.report import Report, page, table

Trouble = Literal["ended", "frozen", "cut off"]
TWINS: Final = ("zone-a", "zone-b", "overall")
"""The processes that are troubled; the plant is what they are the twins of."""
AWAY: Final = 12.0
"""Time for which a process is frozen, or a host cut off, s: longer than a twin may be silent."""
PATIENCE: Final = 60.0
"""Longest time until all twins answer again, s."""
_LATELY: Final = 2.5
"""Time after which a status is old, s."""
_NAME: Final = "outages"


@dataclass(frozen=True, slots=True)
class Outage:
    """What came of one trouble.

    Attributes:
        process: the process, or the host.
        trouble: what was done to it.
        passed: plant time that passed meanwhile, of the time that it took.
        back: time after it was over until all twins told something again, s; None if that did not happen.
        agreed: whether the twin of the line and the plant have the same set-up then.
        left: boxes that left the line meanwhile.
        lost, collisions: boxes lost and vehicles that touched meanwhile.
    """

    process: str
    trouble: Trouble
    passed: float
    back: float | None
    agreed: bool
    left: int
    lost: int
    collisions: int

    @property
    def kept(self) -> bool:
        """Whether the plant went on in real time, all came back and agree, and nothing was lost or touched."""
        whole = self.back is not None and self.agreed and not self.lost and not self.collisions
        return whole and self.passed > 0.9


class _Watch:
    """What is heard of a line."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self._lock = threading.Lock()
        self._plant: PlantState | None = None
        self._statuses: dict[str, tuple[float, Status]] = {}
        bus.subscribe(PLANT_STATE, PlantState, self._hold)
        bus.subscribe(STATUS, Status, self._note)

    def plant(self) -> PlantState:
        """The last state of the plant. Raises CommunicationError."""
        until = time.monotonic() + PATIENCE
        while self._plant is None:
            if time.monotonic() > until:
                raise CommunicationError("the plant of the line tells nothing")
            time.sleep(0.1)
        return self._plant

    def pid(self, service: str) -> int:
        """Process of a service."""
        with self._lock:
            return self._statuses[service][1].pid

    def well(self) -> bool:
        """Whether all twins have told lately that they run."""
        now = time.monotonic()
        with self._lock:
            found = [self._statuses.get(name) for name in TWINS]
        return all(each is not None and now - each[0] < _LATELY and each[1].state == "running" for each in found)

    def agreed(self) -> bool:
        """Whether the twin of the line answers, and has the same set-up as the plant."""
        try:
            state = self.bus.ask(LINE_STATE, None, LineState)
        except CommunicationError:
            return False
        plant = self.plant()
        return (state.version, state.set_up) == (plant.version, plant.set_up)

    def wait_well(self) -> float | None:
        """Time until all twins are well, s; None if they are not in time."""
        began = time.monotonic()
        while not self.well():
            if time.monotonic() - began > PATIENCE:
                return None
            time.sleep(0.1)
        return time.monotonic() - began

    def _hold(self, state: PlantState) -> None:
        self._plant = state

    def _note(self, status: Status) -> None:
        with self._lock:
            self._statuses[status.service] = time.monotonic(), status


@contextmanager
def two_hosts(line: str) -> Iterator[tuple[_Watch, Host]]:
    """A line whose plant, twin and first zone's twin are on one host, and the twin of its other zone on another.

    Raises:
        CommunicationError: it does not start.
    """
    key = new_key()
    with TemporaryDirectory() as name:
        folder = Path(name)
        first = ["--host", "plant", "--host", "zone-a", "--host", "overall", "--twins", "act"]
        second = ["--host", "zone-b", "--twins", "act"]
        with (
            router(folder / "router") as port,
            host(_NAME, line, port, key, folder / "first", first),
            host(_NAME, line, port, key, folder / "second", second) as other,
            joined(_NAME, folder / "first", key) as bus,
        ):
            watch = _Watch(bus)
            if watch.wait_well() is None:
                raise CommunicationError("the twins of the line do not start")
            yield watch, other


def outages(line: str, events: int, seed: int, progress: Progress = lambda done, of: None) -> list[Outage]:
    """Troubles one twin, or the link of a host, after the other.

    Args:
        line: file of the line, or its name in the folder lines; its zones are a and b.
        events: number of troubles.
        seed: number of the random generator that draws them.
        progress: told how many are over.

    Raises:
        CommunicationError: the line does not start.
    """
    generator, found = np.random.default_rng(seed), []
    with two_hosts(line) as (watch, other):
        for number in range(events):
            choice = int(generator.integers(len(TWINS) * 2 + 1))
            found.append(_troubled(watch, other, choice))
            progress(number + 1, events)
    return found


def _troubled(watch: _Watch, other: Host, choice: int) -> Outage:
    """One trouble: the first choices end a twin, the next freeze one, the last cuts the other host off."""
    before, began = watch.plant(), time.monotonic()
    process, trouble = _disturb(watch, other, choice)
    time.sleep(AWAY)
    after = watch.plant()
    passed = (after.time - before.time) / (time.monotonic() - began)
    if trouble == "frozen":
        os.kill(watch.pid(process), signal.SIGCONT)
    elif trouble == "cut off":
        other.link.mend()
    back = watch.wait_well()
    until = time.monotonic() + PATIENCE
    while not (agreed := watch.agreed()) and time.monotonic() < until:
        time.sleep(0.5)
    now = watch.plant()
    counts = now.left - before.left, now.lost - before.lost, now.collisions - before.collisions
    return Outage(process, trouble, passed, back, agreed, *counts)


def _disturb(watch: _Watch, other: Host, choice: int) -> tuple[str, Trouble]:
    if choice == 2 * len(TWINS):
        other.link.cut()
        return "host of zone-b", "cut off"
    process = TWINS[choice % len(TWINS)]
    trouble: Trouble = "ended" if choice < len(TWINS) else "frozen"
    os.kill(watch.pid(process), signal.SIGKILL if trouble == "ended" else signal.SIGSTOP)
    return process, trouble


@dataclass(frozen=True)
class ExperimentLineOutages(ExperimentCommand[list[Outage]]):
    """End and freeze the twins of a running line at random, and cut one of its two hosts off.

    Fails when the plant does not go on in real time, a twin does not come back, the twin of the line and the plant do
    not agree on the set-up afterwards, a box is lost, or vehicles touch.
    """

    name: ClassVar = "line-outages"

    line: str = "default"
    """Line: a file (*.toml) or a name of the folder lines, with the zones a and b."""
    events: int = 20
    """Number of troubles, one after the other."""

    def measure(self, progress: Progress) -> list[Outage]:
        at_least("--events", self.events, 1)
        if sys.platform == "win32":
            raise DtwinError("line-outages: expected a system that can freeze processes")
        return outages(self.line, self.events, self.seed, progress)

    def report(self, result: list[Outage]) -> Report:
        rows = [
            [
                each.process,
                each.trouble,
                f"{each.passed:.2f}",
                "never" if each.back is None else f"{each.back:.0f}",
                "yes" if each.agreed else "no",
                *map(str, (each.left, each.lost, each.collisions)),
            ]
            for each in result
        ]
        words = (
            "Plant, twin of the line and twin of the first zone are on one host, the twin of the second zone on"
            f" another, with a router between them. Each trouble lasts {AWAY:g} s; what was ended is started again by"
            " its supervisor."
        )
        header = ["process", "what", "plant time passed", "all answer after s", "agree", "left", "lost", "touched"]
        return page("A line whose twins are ended, frozen and cut off", words, table(header, rows))

    def figures(self, result: list[Outage]) -> dict[str, Any]:
        return {"outages": msgspec.to_builtins(result), "kept": sum(each.kept for each in result)}

    def passed(self, result: list[Outage]) -> bool:
        return all(each.kept for each in result)
