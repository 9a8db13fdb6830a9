"""Reads ports of running devices again and again: values, members of structures, how often events came."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from types import TracebackType

from iec61499.deploy.located import Place
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import Watch, Watched

FORCED = "!"
"""Mark behind a value that is forced."""


class Watching:
    """Watches ports as long as the block `with` lasts; watches that others have set stay.

    A device without watches is read.
    """

    def __init__(self, places: Sequence[Place]) -> None:
        self._places = places
        self._made: list[Place] = []
        self._watched: set[Place] = set()

    def __enter__(self) -> Watching:
        for place in dict.fromkeys(self._places):
            if place.name in _watches(place.client, place.resource):
                self._watched.add(place)
            elif place.client.request(place.resource, "CREATE", Watch(place.name)).reason is None:
                self._watched.add(place)
                self._made.append(place)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for place in self._made:
            if not place.client.lost:
                place.client.request(place.resource, "DELETE", Watch(place.name))

    def values(self) -> list[Watched]:
        """What the ports have now, in their order. Raises ManagementError and CommunicationError."""
        told: dict[tuple[int, str], dict[str, Watched]] = {}
        found = []
        for place in self._places:
            key = id(place.client), place.resource
            if place in self._watched and key not in told:
                told[key] = _watches(place.client, place.resource)
            value = told.get(key, {}).get(place.name) if place in self._watched else None
            found.append(value or Watched(place.client.read(place.resource, place.name)))
        return found


def opened(name: str, value: str) -> list[tuple[str, str]]:
    """A value with its name, or each member of a structure, `(X:=1,Y:=2)`, with its own."""
    if not (value.startswith("(") and value.endswith(")")):
        return [(name, value)]
    members = [part.partition(":=") for part in _parts(value[1:-1])]
    if not members or not all(sign for _, sign, _ in members):
        return [(name, value)]
    return [each for member, _, inner in members for each in opened(f"{name}.{member.strip()}", inner.strip())]


def shown(value: Watched, text: str) -> str:
    """A value as it is printed: marked where it is forced."""
    return f"{text}{FORCED}" if value.forced else text


def _watches(client: ManagementClient, resource: str) -> dict[str, Watched]:
    found = client.request(resource, "READ", Watch()).watches or {}
    return {port: watched for ports in found.values() for port, watched in ports.items()}


def _parts(text: str) -> Iterator[str]:
    """What stands between the commas of a structure, but for those inside brackets and texts."""
    depth, quote, start = 0, "", 0
    for place, sign in enumerate(text):
        if quote:
            quote = "" if sign == quote and text[place - 1] != "$" else quote
        elif sign in "'\"":
            quote = sign
        elif sign in "([":
            depth += 1
        elif sign in ")]":
            depth -= 1
        elif sign == "," and not depth:
            yield text[start:place]
            start = place + 1
    if text[start:].strip():
        yield text[start:]
