"""The bus of one part of a line, whose messages a test makes up and which only the test hears."""

from __future__ import annotations

import random
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import msgspec

from dtwin.bus.codec import MessageError, Reader, encode
from dtwin.bus.topics.topic import Topic
from dtwin.errors import DtwinError, UnansweredError

STRANGE: tuple[Any, ...] = (
    *(None, -1, 0, 1, 2, 7, 1e308, 2**40, 2**62, 2**64, "", "\u202e\n", "x" * 200, True, [], {}, 0.5, -0.5),
    *("a1", "a2", "b1", "z9", "deburr", "mark", "press", "a", "b", "red", "nothing", "failed", "release"),
)
"""What stands where something else belongs: names from elsewhere, numbers that are too large, other types."""


class StandIn:
    """Takes the place of `Bus` for all keys of a line.

    Attributes:
        refused: reasons and words of what was refused.
        told: the messages that were published, by the names of their topics.
        replies: what others answer, by key; who is not there does not answer.
    """

    def __init__(self, whole: StandIn | None = None, arm: str = "line") -> None:
        self._whole, self._arm = whole or self, arm
        self.refused: list[tuple[str, str]] = []
        self.told: list[msgspec.Struct] = []
        self.replies: dict[str, bytes] = {}
        self.takers: dict[str, Callable[[bytes], Any]] = {}

    def beside(self, arm: str) -> StandIn:
        return StandIn(self._whole, arm)

    def refuse(self, reason: str, detail: str) -> None:
        self._whole.refused.append((reason, detail))

    def publisher(self, topic: Topic, part: str = "*") -> Any:
        return _Wanted(self._whole.told)

    def watch_alive(self, receive: Callable[[str, bool], Any], service: str = "*") -> None:
        receive(service, True)

    def subscribe(self, topic: Topic, message: type[Any], receive: Callable[[Any], Any]) -> None:
        read = Reader(message)
        self._whole.takers[self._key(topic)] = lambda payload: receive(read(payload))

    def answer(self, topic: Topic, message: type[Any], act: Any, read: Any = None) -> None:
        reader = Reader(message)

        def reply(payload: bytes) -> Any:
            asked = reader(payload) if payload else None
            return encode(act(asked) if asked is not None and act is not None else read() if read else None)

        self._whole.takers[self._key(topic)] = reply

    def ask(self, topic: Topic, message: Any, reply: type[Any], timeout: float | None = None) -> Any:
        payload = self._whole.replies.get(self._key(topic))
        if payload is None:
            raise UnansweredError(f"{self._key(topic)}: nobody answers")
        return Reader(reply)(payload)

    def send(self, key: str, payload: bytes) -> Any:
        """Sends a message to who takes it there; whatever is no refusal in words fails the test."""
        try:
            return self.takers[key](payload)
        except MessageError as error:
            self.refuse(error.reason, str(error))
        except DtwinError as error:
            self.refuse("answered", str(error))
        return None

    def send_beside(self, key: str, payload: bytes, serve: Callable[[float], Any]) -> Any:
        """The same for one that waits for another thread, which serves meanwhile."""
        with ThreadPoolExecutor(1) as pool:
            sent = pool.submit(self.send, key, payload)
            while not sent.done():
                serve(0.002)
            return sent.result()

    def _key(self, topic: Topic) -> str:
        return f"{self._arm}/{topic.name}"


class _Wanted:
    wanted = True

    def __init__(self, told: list[msgspec.Struct]) -> None:
        self._told = told

    def __call__(self, message: msgspec.Struct) -> None:
        self._told.append(message)


def damaged(message: msgspec.Struct, generator: random.Random) -> bytes:
    """A message in which a few things are missing, doubled or others, as bytes of which one may be wrong."""
    tree = msgspec.json.decode(encode(message))
    for _ in range(generator.choice((0, 1, 1, 2, 4))):
        _change(tree, generator)
    payload = encode(tree)
    if generator.random() < 0.05:
        place = generator.randrange(len(payload))
        payload = payload[:place] + bytes([generator.randrange(256)]) + payload[place + 1 :]
    return payload


def _change(tree: Any, generator: random.Random) -> None:
    """Changes something somewhere below."""
    at = tree
    while True:
        keys = list(at) if isinstance(at, dict) else list(range(len(at)))
        if not keys:
            return
        key = generator.choice(keys)
        if isinstance(at[key], dict | list) and generator.random() < 0.9:
            at = at[key]
            continue
        way = generator.random()
        if way < 0.1:
            del at[key]
        elif way < 0.2 and isinstance(at, list):
            at.append(at[key])
        elif way < 0.25 and isinstance(at, dict):
            at[str(generator.choice(STRANGE))] = at[key]
        else:
            at[key] = generator.choice(STRANGE)
        return
