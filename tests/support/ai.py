"""An AI's client in memory, and a cell that says whatever a test has it say."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
from mcp import Client

from dtwin.ai.profiles import Limits, Profile
from dtwin.ai.serving import Place, Served, served
from dtwin.bus.messages import (
    EVENTS,
    LOOK,
    MONITORING,
    PREDICT,
    STATUS,
    SUMMARY,
    TICKS,
    PassedTick,
    PassedTicks,
    ServiceSummary,
    Status,
    Summary,
    SummaryRequest,
)
from dtwin.bus.proposals.messages import Look, LookRequest
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import (
    UNITS,
    MonitoredUnit,
    MonitoringVerdict,
    Predicted,
    PredictedMotion,
    PredictionRequest,
    Upload,
)
from dtwin.console.clocks import Clocks
from dtwin.console.commands import Files
from dtwin.controller.settings import USUAL_GAINS
from dtwin.parameters import ArmParameters
from dtwin.signals import Event, Sensors, Voltages

UPLOAD = Upload(3, 1.0, "confirm", "", False, USUAL_GAINS["cascade"], 2.0, "cascade", ArmParameters())
MOTION = PredictedMotion("pickup", "red", True, (0.001,) * 3, (0.002,) * 3, (5.0,) * 3, 0.0)


def place(folder: Path, profile: Profile = "observe", limits: Limits | None = None, **files: Path) -> Place:
    """A place whose files lie in a folder, which is made."""
    folder.mkdir(exist_ok=True)
    kept = Files(files.get("store", folder / "store"), folder / "history.jsonl", files.get("recordings"))
    made = Place("cell", "arm", profile, "tester", kept, folder / "alarms.jsonl", folder / "audit.jsonl")
    return made if limits is None else replace(made, limits=limits)


class Clock:
    """Clocks that a test sets; the steady one grows by enough with every look that no bound of calls is met."""

    def __init__(self, step: float = 0.05) -> None:
        self.now = 0.0
        self.step = step

    def steady(self) -> float:
        self.now += self.step
        return self.now

    def clocks(self) -> Clocks:
        return Clocks(self.steady, lambda: 1.7e9)


class SayingCell:
    """Services that put a text wherever a cell has texts.

    Args:
        bus: session of the services.
    """

    def __init__(self, bus: Bus) -> None:
        self.text = "nothing"
        self.asked: list[Any] = []
        self._publish = {topic: bus.publisher(topic) for topic in (EVENTS, MONITORING, TICKS)}
        self._status = bus.publisher(STATUS, "emulator")
        bus.answer(SUMMARY, SummaryRequest, None, self._summary)
        bus.answer(LOOK, LookRequest, None, lambda: Look(replaced(UPLOAD, text=self.text)))
        bus.answer(PREDICT, PredictionRequest, self._predict)
        for service in ("simulation", "monitoring"):
            bus.announce(service)

    def _predict(self, asked: PredictionRequest) -> Predicted:
        self.asked.append(asked)
        return Predicted(3, (replaced(MOTION, start=self.text[:32]),))

    def _summary(self) -> Summary:
        service = ServiceSummary("running", 100.0, 0, self.text, self.text)
        return Summary({self.text[:32]: service, "emulator": service}, 1, verdict=self.text)

    def say(self, text: str, tick: int) -> None:
        """Puts a text into everything that is published."""
        self.text = text
        time = 0.01 * tick
        sensors = Sensors(tick, time, (0.1, 0.2, 0.3), 0.9, True, text[:32])
        acted = Voltages(tick, time, (1.0, 2.0, 3.0, 0.0), False)
        self._publish[TICKS](PassedTicks((PassedTick(sensors, to_acted(acted)),)))
        self._publish[EVENTS](Event(time, text[:32], text))
        self._status(Status("emulator", "running", 1, last_error=text, doing=text))
        unit = MonitoredUnit("failed", text[:32], text[:32], 0.1, 0.1, 0.9, time, time, True, text)
        units = dict.fromkeys(UNITS, unit)
        self._publish[MONITORING](MonitoringVerdict(time, units, (text,), (text,), 0, 0, (unit,)))


def replaced(message: Any, **fields: Any) -> Any:
    import msgspec

    return msgspec.structs.replace(message, **fields)


def to_acted(voltages: Voltages) -> Any:
    from dtwin.bus.messages import Acted

    return Acted(voltages.sequence, voltages.time, voltages.volts, voltages.box_gripped)


@contextmanager
def serving(bus: Bus, at: Place, clocks: Clocks | None = None) -> Iterator[Served]:
    """A server in this process, with clocks that a test sets, or those given: a real cell needs real ones."""
    with served(bus, at, clocks or Clock().clocks()) as found:
        yield found


def in_a_loop(conversation: Callable[[], Any]) -> Any:
    """What a coroutine function returns, in a thread of its own: that of the tests may run the loop of a browser."""
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(anyio.run, conversation).result()


def talk(served: Served, conversation: Callable[[Client], Any]) -> Any:
    """What an asynchronous conversation of the SDK's own client with a server returns."""

    async def run() -> Any:
        async with Client(served.server) as client:
            return await conversation(client)

    return in_a_loop(run)
