"""`dtwin watch`: what passes on a cell's bus, as it passes."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import msgspec
import tyro

from dtwin.bus.codec import SIZE_LIMIT, MessageError, Reader, encode
from dtwin.bus.messages import EVENTS, SUMMARY, TOPICS, Summary
from dtwin.errors import ParameterError
from dtwin.services.runfile import join
from dtwin.terminal import printable


@dataclass(frozen=True)
class WatchCommand:
    """Print what is published under a key of a cell, one message a line, until Ctrl-C.

    Valid messages are printed as they were understood, others with what is wrong with them. `watch events` begins
    with the last ones that have passed.
    """

    key: tyro.conf.Positional[str] = "**"
    """Key expression below dtwin/CELL/ARM/, e.g. sensors, status/emulator or **."""
    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""
    count: int = 0
    """Messages after which to end; 0 goes on until Ctrl-C."""
    json: bool = False
    """Print messages as they are on the wire."""

    def execute(self) -> int:
        if self.count < 0:
            raise ParameterError(f"--count: expected at least 0, got {self.count}")
        inbox: SimpleQueue[tuple[str, bytes]] = SimpleQueue()
        with join(self.cell, self.zenoh) as bus:
            bus.watch_raw(self.key, lambda key, payload: inbox.put((key, payload)))
            waiting: list[tuple[str, bytes]] = []
            if self.key == EVENTS.name:
                # Asked for once they are received: what passes meanwhile comes twice rather than never, and after it.
                past = bus.ask(SUMMARY, None, Summary).events
                waiting = [(bus.key(EVENTS), encode(event)) for event in reversed(past)]
            printed = 0
            while not self.count or printed < self.count:
                try:
                    key, payload = waiting.pop() if waiting else inbox.get(timeout=1.0)
                except Empty:
                    continue
                print(printable(f"{key} {describe(key, payload, self.json)}"))
                printed += 1
                if inbox.empty() and not waiting:
                    sys.stdout.flush()
        return 0


def describe(key: str, payload: bytes, wire: bool = False) -> str:
    """A message of a key in one line: its fields for people, or as it is on the wire."""
    topic = "/".join(key.split("/")[3:])
    for reader in _readers(topic):
        try:
            message = reader(payload)
            return encode(message).decode() if wire else " ".join(_fields(msgspec.to_builtins(message)))
        except MessageError as error:
            return f"invalid ({error}): {_shown(payload)}"
    return _shown(payload)


def _fields(message: dict[str, Any]) -> Iterator[str]:
    """The fields of a message, numbers rounded as a person reads them."""
    for name, value in message.items():
        if name != "schema":
            yield f"{name}={_readable(value)}"


def _readable(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return f"({', '.join(map(_readable, value))})"
    if isinstance(value, dict):
        return f"({' '.join(_fields(value))})"
    return value if isinstance(value, str) and value and " " not in value else repr(value)


def _readers(topic: str) -> list[Reader]:
    """The reader of a topic, if it is a known one."""
    names = {known.name.partition("/*")[0]: known.message for known in TOPICS if known.kind == "publication"}
    first = topic if topic in names else topic.partition("/")[0]
    message = names.get(first)
    return [] if message is None else [Reader(message)]


def _shown(payload: bytes) -> str:
    return payload[:SIZE_LIMIT].decode(errors="backslashreplace")
