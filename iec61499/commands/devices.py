"""`fb watch`, `force`, `trigger`, `start` and `stop`: what runs on devices, from outside."""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass

import tyro

from iec61499.deploy.located import Place, block, port, sessions
from iec61499.deploy.watching import Watching, opened, shown
from iec61499.errors import ToolError
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import ManagedBlock, ManagedConnection, RequestAction
from iec61499.output import printable


@dataclass(frozen=True)
class FbWatch:
    """Print values of running devices (4diac FORTE or `fb run`) again and again.

    Of an event it prints how often it came since it is watched, of a structure every member. A value that is forced
    has a mark, as in 5!.
    """

    target: tyro.conf.Positional[str]
    """HOST:PORT or unix:FOLDER/PORT of the device management, or a system (.sys): all its devices, where it says."""
    names: tyro.conf.Positional[tuple[str, ...]]
    """Ports: APPLICATION.BLOCK.PORT, as 4diac IDE calls them, or BLOCK.PORT of a block of the resource alone; with
    the name of the resource, or of device and resource, in front where that is needed."""
    interval: float = 0.5
    """Time between two readings, s."""
    count: int = 0
    """Number of readings; 0 goes on until Ctrl-C."""

    def execute(self) -> int:
        if not 0.001 <= self.interval < float("inf"):
            raise ToolError(f"--interval: expected at least 0.001 s, got {self.interval}")
        if not self.names:
            raise ToolError("expected the name of at least one port, e.g. CELL.PLANNER.THETA_D1")
        with sessions(self.target) as clients:
            places = [port(clients, name) for name in self.names]
            with Watching(places) as watching:
                for number in itertools.count(1):
                    values = watching.values()
                    rows = [opened(place.called, each.value) for place, each in zip(places, values, strict=True)]
                    if number == 1:
                        print("\t".join(printable(name) for row in rows for name, _ in row), flush=True)
                    texts = [shown(each, text) for each, row in zip(values, rows, strict=True) for _, text in row]
                    print("\t".join(map(printable, texts)), flush=True)
                    if number == self.count:
                        break
                    time.sleep(self.interval)
        return 0


@dataclass(frozen=True)
class FbForce:
    """Force ports of running devices to values, whatever comes there, until Ctrl-C; then they are free again."""

    target: tyro.conf.Positional[str]
    """HOST:PORT or unix:FOLDER/PORT of the device management, or a system (.sys): all its devices, where it says."""
    values: tyro.conf.Positional[tuple[str, ...]]
    """NAME=VALUE: a port, as `fb watch` names it, and a literal, e.g. CELL.PUMP.SPEED=2.5."""
    seconds: float = 0.0
    """Time after which they are free again, s; 0 waits for Ctrl-C."""

    def execute(self) -> int:
        if not 0.0 <= self.seconds < float("inf"):
            raise ToolError(f"--seconds: expected at least 0 s, got {self.seconds}")
        parts = [value.partition("=") for value in self.values]
        if not parts or not all(sign and name for name, sign, _ in parts):
            raise ToolError("expected NAME=VALUE, e.g. CELL.PUMP.SPEED=2.5")
        with sessions(self.target) as clients:
            places = [(port(clients, name), literal) for name, _, literal in parts]
            forced: list[Place] = []
            try:
                for place, literal in places:
                    _force(place, literal, "true")
                    forced.append(place)
                    print(printable(f"{place.called} is forced to {literal}"), flush=True)
                time.sleep(self.seconds) if self.seconds else _wait()
            finally:
                for place in forced:
                    if not place.client.lost:
                        _force(place, "", "false")
                        print(printable(f"{place.called} is free"), flush=True)
        return 0


@dataclass(frozen=True)
class FbTrigger:
    """Let events of running devices happen, one after the other."""

    target: tyro.conf.Positional[str]
    """HOST:PORT or unix:FOLDER/PORT of the device management, or a system (.sys): all its devices, where it says."""
    events: tyro.conf.Positional[tuple[str, ...]]
    """Events, as `fb watch` names ports: of an event output all receivers get it."""

    def execute(self) -> int:
        if not self.events:
            raise ToolError("expected the name of at least one event")
        with sessions(self.target) as clients:
            for place in [port(clients, name) for name in self.events]:
                place.client.trigger(place.resource, place.name)
                print(printable(f"{place.called} happened"))
        return 0


@dataclass(frozen=True)
class FbStart:
    """Start what runs on devices (4diac FORTE or `fb run`), or single blocks."""

    target: tyro.conf.Positional[str]
    """HOST:PORT or unix:FOLDER/PORT of the device management, or a system (.sys): all its devices, where it says."""
    blocks: tyro.conf.Positional[tuple[str, ...]] = ()
    """Blocks, APPLICATION.BLOCK; without any all resources."""

    def execute(self) -> int:
        return _change(self.target, self.blocks, "START")


@dataclass(frozen=True)
class FbStop:
    """Stop what runs on devices (4diac FORTE or `fb run`), or single blocks."""

    target: tyro.conf.Positional[str]
    """HOST:PORT or unix:FOLDER/PORT of the device management, or a system (.sys): all its devices, where it says."""
    blocks: tyro.conf.Positional[tuple[str, ...]] = ()
    """Blocks, APPLICATION.BLOCK; without any all resources."""

    def execute(self) -> int:
        return _change(self.target, self.blocks, "STOP")


def _force(place: Place, literal: str, force: str) -> None:
    place.client.demand(place.resource, "WRITE", ManagedConnection(literal, place.name, force))


def _wait() -> None:
    """Waits for Ctrl-C, which is how it is meant to end."""
    try:
        while True:
            time.sleep(3600.0)
    except KeyboardInterrupt:
        pass


def _change(target: str, blocks: tuple[str, ...], action: RequestAction) -> int:
    """Starts or stops blocks, or all resources; what is refused is told, and is no error for a resource."""
    done = "started" if action == "START" else "stopped"
    with sessions(target) as clients:
        if blocks:
            for place in [block(clients, name) for name in blocks]:
                place.client.demand(place.resource, action, ManagedBlock(place.name, ""))
                print(printable(f"{place.called} {done}"))
            return 0
        for client in clients.values():
            _change_resources(client, action, done)
    return 0


def _change_resources(client: ManagementClient, action: RequestAction, done: str) -> None:
    for resource in client.blocks(""):
        refused = client.request(resource.name, action).reason
        answer = f"does not {action.lower()}: {refused}" if refused else done
        print(printable(f"{resource.name} {answer}"))
