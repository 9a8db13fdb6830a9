"""Sixteen arms in real time over one router: late cycles, messages and bytes; and what a thousand arms would take."""

from __future__ import annotations

import os
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, Final

import msgspec

from dtwin.bus.line.plant import PlantState
from dtwin.bus.line.topics import PLANT_STATE
from dtwin.bus.messages import SENSORS
from dtwin.bus.session import Bus
from dtwin.bus.signature import new_key
from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from dtwin.errors import CommunicationError
from dtwin.line.file import line_of
from dtwin.line.line import CYCLE, Line
from dtwin.line.station import EmulatedStation
from dtwin.parameters import PERIOD
from dtwin.signals import Sensors
from evidence.experiment import ExperimentCommand
from evidence.line.network import host, joined, router
from evidence.line.wide import MOST, STATIONS, wide_line
from evidence.report import Report, page, table

THOUSAND: Final = 1000
DAY: Final = 86_400.0
"""s"""
_NAME: Final = "scale"
_FLOOD: Final = 5.0
"""Time for which a router is flooded, s."""
_WORKED: Final = 60.0
"""Plant time of the log whose size is measured, s."""


@dataclass(frozen=True, slots=True)
class Scale:
    """What was measured.

    Attributes:
        arms: number of arms.
        seconds: time that was watched, s.
        late: share of the cycles that ended more than a tick after the next one was due.
        messages: messages a second that a listener to everything heard.
        bytes: their payload, bytes a second.
        flooded: messages a second that one sender passes to one listener through the router.
        row: bytes of a tick of one arm in a Parquet log.
    """

    arms: int
    seconds: float
    late: float
    messages: float
    bytes: float
    flooded: float
    row: float


class _Heard:
    """Counts everything that is published of a line."""

    def __init__(self, bus: Bus, line: Line) -> None:
        self.messages = self.bytes = 0
        self._lock = threading.Lock()
        names = [*(station.name for station in line.stations), *(zone.name for zone in line.zones)]
        for each in [bus, *map(bus.beside, names)]:
            each.watch_raw("**", self._count)

    def _count(self, key: str, payload: bytes) -> None:
        with self._lock:
            self.messages += 1
            self.bytes += len(payload)


def measured(seconds: float, progress: Progress = lambda done, of: None) -> Scale:
    """Runs a line of sixteen arms in real time over a router for some seconds.

    Raises:
        CommunicationError: the line does not start.
    """
    key = new_key()
    with TemporaryDirectory() as name:
        folder = Path(name)
        file = folder / "wide.toml"
        file.write_text(wide_line(MOST), encoding="utf-8")
        line = line_of(str(file))
        words = ["--twins", "off"]
        with (
            router(folder / "router") as port,
            host(_NAME, str(file), port, key, folder / "host", words),
            joined(_NAME, folder / "host", key) as bus,
        ):
            heard, states = _Heard(bus, line), list[PlantState]()
            bus.subscribe(PLANT_STATE, PlantState, states.append)
            _wait(lambda: len(states) > 1, "the plant of the line tells nothing")
            first, messages, size, began = states[-1], heard.messages, heard.bytes, time.monotonic()
            for second in range(round(seconds)):
                time.sleep(1.0)
                progress(second + 1, round(seconds))
            last, passed = states[-1], time.monotonic() - began
            cycles = (last.time - first.time) / CYCLE
            rates = (heard.messages - messages) / passed, (heard.bytes - size) / passed
            flooded = _flooded(bus)
        return Scale(
            STATIONS * MOST, passed, (last.late - first.late) / max(cycles, 1.0), *rates, flooded, _row(line)
        )


def _flooded(bus: Bus) -> float:
    """Messages a second that a sender which waits for the router passes through it to a listener."""
    heard: list[float] = []
    nobody = bus.beside("nobody")
    nobody.subscribe(SENSORS, Sensors, lambda sample: heard.append(time.monotonic()))
    send = nobody.publisher(SENSORS, lossless=True)
    began, number = time.monotonic(), 0
    while time.monotonic() - began < _FLOOD:
        send(Sensors(number, PERIOD * number, (0.1, -1.2, 0.7), 0.3, False, ""))
        number += 1
    _wait(lambda: len(heard) >= number or time.monotonic() - heard[-1] > 1.0, "nothing passes the router")
    return len(heard) / (heard[-1] - began)


def _wait(condition: Any, otherwise: str) -> None:
    until = time.monotonic() + 30.0
    while not condition():
        if time.monotonic() > until:
            raise CommunicationError(otherwise)
        time.sleep(0.05)


def _row(line: Line) -> float:
    """Bytes of a tick of an arm at work in a Parquet log."""
    station = EmulatedStation(line.stations[0])
    while len(station.log) * PERIOD < _WORKED:
        if station.advance(10).arm == 0:
            station.give("bring", 0.2, "blue")
    log = station.log
    with TemporaryDirectory() as folder:
        path = Path(folder) / "log.parquet"
        log.freeze().write_parquet(path)
        return os.path.getsize(path) / len(log)


@dataclass(frozen=True)
class ExperimentLineScale(ExperimentCommand[Scale]):
    """Run sixteen arms in real time over one router, listen to everything, and reckon what a thousand would take.

    Fails when one percent of the cycles or more are late.
    """

    name: ClassVar = "line-scale"

    seconds: float = 60.0
    """Time that is watched, s."""

    def measure(self, progress: Progress) -> Scale:
        at_least("--seconds", int(self.seconds), 1)
        return measured(self.seconds, progress)

    def report(self, result: Scale) -> Report:
        each = result.messages / result.arms, result.bytes / result.arms
        cores = os.cpu_count() or 1
        seen = table(
            ["measured", "value"],
            [
                [f"late cycles of {result.arms} arms in real time on {cores} cores", f"{100.0 * result.late:.2f} %"],
                ["messages that a listener to everything heard, a second", f"{result.messages:.0f}"],
                ["their payload, MB a second", f"{result.bytes / 1e6:.2f}"],
                ["messages a second from one sender to one listener through the router", f"{result.flooded:.0f}"],
                ["bytes of a tick of an arm in a Parquet log", f"{result.row:.1f}"],
            ],
        )
        passing = THOUSAND * each[0]
        reckoned = table(
            [f"reckoned for {THOUSAND} arms", "value"],
            [
                ["messages a second, when somebody listens to everything", f"{passing:.0f}"],
                ["routers, each half busy with what passes one sender and one listener", f"{routers(result):d}"],
                ["payload, Mbit a second", f"{8.0 * THOUSAND * each[1] / 1e6:.0f}"],
                ["logs of a day, TB", f"{THOUSAND * result.row * DAY / PERIOD / 1e12:.2f}"],
                ["plants of sixteen arms", f"{-(-THOUSAND // result.arms):d}"],
            ],
        )
        words = (
            "A line of four zones with four stations each works in real time; everything goes through one router, and"
            " a listener takes it all. The first thing that breaks with more arms is a listener to everything: one"
            f" process takes about {result.flooded:.0f} messages a second. Who needs one zone subscribes to it."
        )
        return page("Sixteen arms in real time, and a thousand on paper", words, seen, reckoned)

    def figures(self, result: Scale) -> dict[str, Any]:
        return {"scale": msgspec.to_builtins(result), "routers_for_1000_arms": routers(result)}

    def passed(self, result: Scale) -> bool:
        return result.late < 0.01


def routers(result: Scale) -> int:
    """Number of routers that a thousand arms take, each half busy."""
    return max(1, -(-round(THOUSAND * result.messages / result.arms) // max(1, round(result.flooded / 2.0))))
