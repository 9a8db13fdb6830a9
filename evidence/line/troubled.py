"""The blocks of a line on a resource for each device, in one process, between which messages are lost, late or told
twice, and whose devices end and freeze."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from dtwin.controller.ports import BLOCKS
from dtwin.errors import CommunicationError
from dtwin.line.control import servers
from dtwin.line.line import Line
from dtwin.line.system import RESOURCE, system
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.model import FBNetwork
from iec61499.runtime.communication import Channel, CommunicationPort, LocalTransport, Values
from iec61499.runtime.resource import Resource

Trouble = Literal["ended", "frozen", "lost", "twice", "late"]
TROUBLES: Final[tuple[Trouble, ...]] = ("ended", "frozen", "lost", "twice", "late")
MESSAGES: Final[tuple[Trouble, ...]] = ("lost", "twice", "late")
"""Those of messages."""
_SPARED: Final = 50
"""Most samples for which a device that has not answered is not asked."""
_MESSAGES: Final = 5000
"""Most messages that may follow from one sample."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message on its way: device and port to which it goes, and what it says.

    A datagram finds whoever listens at its address when it comes, also a device that has begun anew meanwhile:
    `channel` is the number of the channel of the device in that case, None of a request of the plant.
    """

    device: str
    port: CommunicationPort
    values: Values
    channel: int | None = None


class Messages:
    """Messages on their way between devices.

    Args:
        generator: draws which are troubled.
        numbers: which of the values of a message are its numbers, by the device and the block that it comes to.

    Attributes:
        trouble: what happens to them now, None for nothing.
        share: share of them that it happens to.
        news: number of messages so far that say something else than the one of the same event before them, whatever
            their numbers.
        loses: number of the one of these that is lost, -1 for none.
    """

    def __init__(self, generator: np.random.Generator, numbers: Mapping[tuple[str, str], frozenset[int]]) -> None:
        self.trouble: Trouble | None = None
        self.share = 0.0
        self.news, self.loses = 0, -1
        self._generator, self._numbers = generator, numbers
        self._waiting: deque[Message] = deque()
        self._late: deque[Message] = deque()
        self._said: dict[tuple[CommunicationPort, Any], tuple[Any, ...]] = {}

    def send(self, message: Message) -> None:
        """Takes a message, and may lose it, tell it twice or keep it for later."""
        numbers = self._numbers.get((message.device, message.port.name), frozenset())
        values = tuple(value for k, value in enumerate(message.values) if k not in numbers)
        what = message.port, None if 0 in numbers else values[0]
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


def _numbers(networks: Mapping[str, FBNetwork]) -> dict[tuple[str, str], frozenset[int]]:
    """Which of the values that come to a block of a device are numbers of the sample from which a message follows.

    By these a NEWEST_MESSAGE tells what is old, and the plant, as the last value of an answer, what it was asked.
    """
    found: dict[tuple[str, str], frozenset[int]] = {}
    for device, network in networks.items():
        counts = {f"{block.name}.NUMBER" for block in network.blocks if block.type_name == "NEWEST_MESSAGE"}
        for block in network.blocks:
            kind, _, sent = block.type_name.partition("_")
            if kind == "SERVER":
                counts.add(f"{block.name}.SD_{sent.partition('_')[0]}")
        for connection in network.data:
            name, _, value = connection.source.partition(".RD_")
            if connection.destination in counts and value:
                found[device, name] = found.get((device, name), frozenset()) | {int(value) - 1}
    return found


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
        self._networks = {name: resource_network(whole, f"{name}.{RESOURCE}") for name in self.names}
        self.messages = Messages(generator, _numbers(self._networks))
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
        opened = self._opened.setdefault(name, [])
        channel = len(opened)
        opened.append(port)
        return self._local.open(port, lambda values: self.messages.send(Message(name, port, values, channel)))

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
            elif message.device in self._resources:
                self._deliver(message)
        raise CommunicationError(f"the devices of the line do not come to rest within {_MESSAGES} messages")

    def _deliver(self, message: Message) -> None:
        port = message.port if message.channel is None else self._opened[message.device][message.channel]
        if port.is_open:
            port.deliver(message.values)


class _Way:
    """The transport of one device."""

    def __init__(self, devices: TroubledDevices, name: str) -> None:
        self._devices, self._name = devices, name

    def open(self, port: CommunicationPort) -> Channel:
        return self._devices.open(self._name, port)
