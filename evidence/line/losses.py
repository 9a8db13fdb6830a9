"""The blocks of a line on a resource for each device, in one process, between which messages are lost, late or told
twice, and whose devices end and freeze: boxes must go on leaving the line.

Equal seeds give equal events. Nothing waits for a clock, so that an hour of a line takes seconds.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, ClassVar, Final, Literal

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress, spread
from dtwin.commands.frame import WorkforceOption, at_least
from dtwin.controller.ports import BLOCKS
from dtwin.errors import CommunicationError
from dtwin.line.control import servers
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.line import Line
from dtwin.line.station import WorkTimes
from dtwin.line.system import RESOURCE, system
from evidence.experiment import ExperimentCommand
from evidence.line.timed import TimedLine
from evidence.report import Report, page, table
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.runtime.communication import Channel, CommunicationPort, LocalTransport, Values
from iec61499.runtime.resource import Resource

Trouble = Literal["ended", "frozen", "lost", "twice", "late"]
TROUBLES: Final[tuple[Trouble, ...]] = ("ended", "frozen", "lost", "twice", "late")
FILLING: Final = 100.0
"""Time before the first trouble, s."""
AFTERWARDS: Final = 200.0
"""Time after the last one in which boxes must leave the line, s."""
_AGAIN: Final = 24.0
"""Longest time from the end of a trouble to the next one, s."""
_LENGTHS: Final = (0.0, 0.1, 1.0, 3.0, 8.0, 20.0)
"""How long a trouble lasts, s."""
_SHARES: Final = (0.02, 0.1, 0.5)
"""Shares of the messages that are troubled."""
_SPARED: Final = 50
"""Most samples for which a device that has not answered is not asked."""
_MESSAGES: Final = 5000
"""Most messages that may follow from one sample."""
_LEAST: Final = 4
"""Boxes that must leave afterwards, where some eight come."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message on its way: device and port to which it goes, and what it says."""

    device: str
    port: CommunicationPort
    values: Values


class Messages:
    """Messages on their way between devices.

    Args:
        generator: draws which are troubled.

    Attributes:
        trouble: what happens to them now, None for nothing.
        share: share of them that it happens to.
        news: number of messages so far that say something else than the one of the same event before them.
        loses: number of the one of these that is lost, -1 for none.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        self.trouble: Trouble | None = None
        self.share = 0.0
        self.news, self.loses = 0, -1
        self._generator = generator
        self._waiting: deque[Message] = deque()
        self._late: deque[Message] = deque()
        self._said: dict[tuple[CommunicationPort, Any], tuple[Any, ...]] = {}

    def send(self, message: Message) -> None:
        """Takes a message, and may lose it, tell it twice or keep it for later."""
        values = tuple(message.values)
        what = message.port, values[0]
        if self._said.get(what) != values:
            self._said[what] = values
            self.news += 1
            if self.news == self.loses:
                return
        if self.trouble is None or self._generator.random() >= self.share:
            self._waiting.append(message)
        elif self.trouble == "late":
            self._late.append(message)
        elif self.trouble == "twice":
            self._waiting.extend((message, message))

    def bring(self, messages: Sequence[Message]) -> None:
        """Takes messages that are told now, whatever happens to others."""
        self._waiting.extend(messages)

    def next(self) -> Message | None:
        """The one that has waited longest, None if there is none."""
        return self._waiting.popleft() if self._waiting else None

    def well(self) -> None:
        """Ends the trouble, and brings what was kept for later."""
        self.trouble = None
        self._waiting.extend(self._late)
        self._late.clear()


class TroubledDevices:
    """The blocks of a line, each on the resource of its device; these end and freeze.

    Args:
        line: the line.
        generator: draws what is troubled, and for how long a device that did not answer is not asked.

    Attributes:
        names: names of the devices.
        messages: what is on its way between them.
    """

    def __init__(self, line: Line, generator: np.random.Generator) -> None:
        self._library = Library([BLOCKS])
        whole = self._library.complete(system(line))
        self.names = [device.name for device in whole.devices]
        self.messages = Messages(generator)
        self._networks = {name: resource_network(whole, f"{name}.{RESOURCE}") for name in self.names}
        self._servers = set(servers(line))
        self._generator = generator
        self._local = LocalTransport()
        self._resources: dict[str, Resource] = {}
        self._opened: dict[str, list[CommunicationPort]] = {}
        self._ports: dict[str, tuple[str, CommunicationPort, list[tuple[Any, ...]]]] = {}
        self._frozen: dict[str, list[Message]] = {}
        self._spared: dict[str, int] = {}
        for name in self.names:
            self.begin(name)

    def begin(self, name: str) -> None:
        """Starts a device, which knows nothing."""
        resource = self._resources[name] = Resource(self._networks[name], self._library, _Way(self, name))
        for block in self._servers & set(resource.states()):
            answers: list[tuple[Any, ...]] = []
            port = resource.port(block)
            port.attach(answers.append)
            self._ports[block] = name, port, answers
        resource.start()
        self._settle()

    def end(self, name: str) -> None:
        """Ends a device; what was on its way to it is lost."""
        del self._resources[name]
        for port in self._opened.pop(name, ()):
            port.close()

    def freeze(self, name: str) -> None:
        """Lets a device stand; what comes waits in front of it."""
        self._frozen[name] = []

    def thaw(self, name: str) -> None:
        """Lets it go on with all that has come meanwhile, however old it is."""
        self.messages.bring(self._frozen.pop(name))
        self._settle()

    def open(self, name: str, port: CommunicationPort) -> Channel:
        """Opens a channel for a block of a device."""
        self._opened.setdefault(name, []).append(port)
        return self._local.open(port, lambda values: self.messages.send(Message(name, port, values)))

    def exchange(self, block: str, values: Sequence[Any]) -> tuple[Any, ...]:
        """The answer of a block. Raises CommunicationError: it does not come, or it is not asked yet."""
        name, port, answers = self._ports[block]
        if self._spared.get(block):
            self._spared[block] -= 1
            raise CommunicationError(f"{block} is not asked yet")
        answers.clear()
        if name in self._resources:
            self.messages.bring([Message(name, port, tuple(values))])
            self._settle()
        if answers:
            return answers[-1]
        self._spared[block] = int(self._generator.integers(0, _SPARED + 1))
        raise CommunicationError(f"{block} does not answer")

    def now(self) -> Any:
        """None: what is on its way belongs to it."""

    def resume(self, now: Any) -> None:
        """Does nothing."""

    def _settle(self) -> None:
        for _ in range(_MESSAGES):
            for name, resource in self._resources.items():
                if name not in self._frozen and not resource.is_idle:
                    resource.run_until_idle()
            message = self.messages.next()
            if message is None:
                return
            if message.device in self._frozen:
                self._frozen[message.device].append(message)
            elif message.device in self._resources and message.port.is_open:
                message.port.deliver(message.values)
        raise CommunicationError(f"the devices of the line do not come to rest within {_MESSAGES} messages")


class _Way:
    """The transport of one device."""

    def __init__(self, devices: TroubledDevices, name: str) -> None:
        self._devices, self._name = devices, name

    def open(self, port: CommunicationPort) -> Channel:
        return self._devices.open(self._name, port)


@dataclass(frozen=True, slots=True)
class LossTrial:
    """A line that is troubled.

    Attributes:
        line: the line: a file or a name of the folder lines.
        seed: number of the random generator.
        troubles: number of troubles, one after the other.
        loses: number of the only message that is lost instead, counted from the end of the filling on; 0 for none.
    """

    line: str
    seed: int
    troubles: int
    loses: int = 0


@dataclass(frozen=True, slots=True)
class LossOutcome:
    """What came of it.

    Attributes:
        trial: what was done.
        left: boxes that left the line in the time afterwards.
        unfinished, lost, collisions: of the whole run.
        told: the troubles, with time and device.
    """

    trial: LossTrial
    left: int
    unfinished: int
    lost: int
    collisions: int
    told: tuple[str, ...] = field(default=())

    @property
    def kept(self) -> bool:
        """Whether boxes went on leaving, finished, and nothing was lost or touched."""
        return self.left >= _LEAST and not (self.unfinished or self.lost or self.collisions)


class _Run(TimedLine):
    """One on troubled devices."""

    def __init__(self, line: Line, generator: np.random.Generator) -> None:
        places = sorted({operation.place for operation in line.operations})
        times = WorkTimes(0.5, dict.fromkeys(places, 2.8), dict.fromkeys(places, 2.3))
        self.devices = TroubledDevices(line, generator)
        super().__init__(line, self.devices, {station.name: times for station in line.stations})


def troubled(trial: LossTrial) -> LossOutcome:
    """Troubles a line, and lets it go on.

    Raises:
        DtwinError: a box has vanished.
    """
    generator = np.random.default_rng(trial.seed)
    run = _Run(line_of(trial.line), generator)
    run.work(FILLING + (0.0 if trial.loses else _AGAIN * float(generator.random())))
    if trial.loses:
        run.devices.messages.loses = run.devices.messages.news + trial.loses
    told = [_trouble(run, generator) for _ in range(trial.troubles)]
    before, plant = len(run.plant.left), run.plant
    run.work(AFTERWARDS)
    left = len(plant.left) - before
    return LossOutcome(trial, left, plant.unfinished, plant.lost, plant.collisions, tuple(told))


def _trouble(run: _Run, generator: np.random.Generator) -> str:
    """One trouble, and some time after it; what it was."""
    devices, began = run.devices, run.plant.time
    name, trouble = str(generator.choice(devices.names)), TROUBLES[int(generator.integers(len(TROUBLES)))]
    seconds = float(generator.choice(_LENGTHS))
    if trouble == "ended":
        devices.end(name)
        run.work(seconds)
        devices.begin(name)
    elif trouble == "frozen":
        devices.freeze(name)
        run.work(seconds)
        devices.thaw(name)
    else:
        name = "messages"
        devices.messages.trouble, devices.messages.share = trouble, float(generator.choice(_SHARES))
        run.work(seconds)
        devices.messages.well()
    run.work(_AGAIN * float(generator.random()))
    return f"{began:.1f} s: {name} {trouble} for {seconds:g} s"


@cache
def news_within(line: str, seconds: float) -> int:
    """Number of messages between devices that say something new, in a time from the end of the filling on."""
    run = _Run(line_of(line), np.random.default_rng(0))
    run.work(FILLING)
    before = run.devices.messages.news
    run.work(seconds)
    return run.devices.messages.news - before


@dataclass(frozen=True)
class ExperimentLineLosses(WorkforceOption, ExperimentCommand[list[LossOutcome]]):
    """Lose, repeat and delay the messages between the devices of a line, and end and freeze these, in one process.

    Fails when boxes do not go on leaving, leave unfinished or are lost, or vehicles touch.
    """

    name: ClassVar = "line-losses"

    line: str = DEFAULT_NAME
    """Line: a file (*.toml) or a name of the folder lines."""
    runs: int = 40
    """Number of runs with random troubles."""
    troubles: int = 6
    """Number of troubles in each."""
    every: float = 0.0
    """Time in which every message with news is lost once, each in a run of its own, s."""

    def measure(self, progress: Progress) -> list[LossOutcome]:
        at_least("--runs", self.runs, 0)
        at_least("--troubles", self.troubles, 0)
        at_least("--every", self.every, 0.0)
        trials = [LossTrial(self.line, self.seed + k, self.troubles) for k in range(self.runs)]
        count = news_within(self.line, self.every) if self.every else 0
        trials += [LossTrial(self.line, self.seed, 0, 1 + k) for k in range(count)]
        return spread(troubled, trials, self.workforce(), progress)

    def report(self, result: list[LossOutcome]) -> Report:
        rows = [
            [
                f"message {each.trial.loses} lost" if each.trial.loses else "; ".join(each.told),
                *map(str, (each.left, each.unfinished, each.lost, each.collisions)),
            ]
            for each in sorted(result, key=lambda each: each.kept)
        ]
        words = (
            f"{sum(each.kept for each in result)} of {len(result)} lines went on. Boxes that left are those of"
            f" {AFTERWARDS:g} s after the last trouble. The arms only take time."
        )
        header = ["what", "boxes that left", "unfinished", "lost", "touched"]
        return page("A line whose messages are lost and whose devices begin anew", words, table(header, rows))

    def figures(self, result: list[LossOutcome]) -> dict[str, Any]:
        return {"runs": msgspec.to_builtins(result), "kept": sum(each.kept for each in result)}

    def passed(self, result: list[LossOutcome]) -> bool:
        return all(each.kept for each in result)
