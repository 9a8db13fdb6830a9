"""A resource as device management sees it: a network put together request by request, before and while it runs.

States and reasons are those of 4diac FORTE 2.0. What changes while the resource runs is changed before its next
event, all at once; blocks that stay keep their state. A block created then waits for its own START.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, Literal

from iec61499 import model
from iec61499.device.carrying import carried_values, states_of
from iec61499.device.drawn_network import DrawnNetwork, printed, value_of
from iec61499.device.running import Launcher, Running
from iec61499.errors import FunctionBlockError, ToolError
from iec61499.library import Library
from iec61499.management.protocol import (
    ManagedBlock,
    ManagedConnection,
    ManagementError,
    RequestAction,
    Watched,
)
from iec61499.net.address import StreamAddress
from iec61499.runtime.operation import EventCounts, Operation
from iec61499.runtime.resource import Resource

ResourceState = Literal["IDLE", "RUNNING", "STOPPED", "KILLED"]
_MOVES: Final[dict[RequestAction, tuple[tuple[ResourceState, ...], ResourceState]]] = {
    "START": (("IDLE", "STOPPED"), "RUNNING"),
    "STOP": (("RUNNING",), "STOPPED"),
    "KILL": (("RUNNING",), "KILLED"),
    "RESET": (("STOPPED", "KILLED"), "IDLE"),
}
"""For every action the states that it is possible in, and the state that it leads to."""
WATCHES: Final = 256
"""Most ports of a resource that are watched at once."""


@dataclass(frozen=True, slots=True)
class _Kept:
    """What a resource was before a change that is gathered."""

    drawn: DrawnNetwork
    watched: dict[str, None]
    forced: dict[str, Any]
    halted: dict[str, ResourceState]
    counts: dict[str, int]


class ManagedResource:
    """One resource; every method raises ManagementError with FORTE's reason when it cannot do what it is asked.

    Args:
        name: the resource's name.
        type_name: the resource's type, which a QUERY tells.
        library: finds the block types that requests name.
        launch: makes a network run; raises FunctionBlockError or CommunicationError when it cannot.
        network: a network from a file; None for one that requests put together.
        fixed: whether what runs cannot be changed.
    """

    def __init__(
        self,
        name: str,
        type_name: str,
        library: Library,
        launch: Launcher,
        network: model.FBNetwork | None = None,
        fixed: bool = False,
    ) -> None:
        self.fixed = fixed
        self.name = name
        self.type_name = type_name
        self.state: ResourceState = "IDLE"
        self._drawn = DrawnNetwork(name, library, network or model.FBNetwork(file=name))
        self._launch = launch
        self._running: Running | None = None
        self._prepared: Running | ManagementError | None = None
        self._watched: dict[str, None] = {}
        self._forced: dict[str, Any] = {}
        self._halted: dict[str, ResourceState] = {}
        self._fresh: set[str] = set()
        self._gone: set[str] = set()
        self._counts = EventCounts()
        self._before: _Kept | None = None
        self._writes: dict[str, Any] = {}
        if network is None:
            self._drawn.create_block("START", "E_RESTART")

    def addresses(self) -> dict[str, StreamAddress]:
        """Where its SERVER and SUBSCRIBE blocks listen, by the block's dotted name."""
        return self._running.addresses if self._running is not None else {}

    def runs(self) -> bool:
        return self._running is not None

    def is_event(self, name: str) -> bool:
        return self._drawn.is_event(name)

    def blocks(self) -> tuple[ManagedBlock, ...]:
        return self._drawn.blocks()

    def connections(self) -> tuple[ManagedConnection, ...]:
        return self._drawn.connections()

    def network(self) -> model.FBNetwork:
        """What START runs."""
        return self._drawn.network()

    def create_block(self, name: str, type_name: str) -> None:
        """Creates a block; in a resource that has been started it waits for its own START."""
        self._drawn.create_block(name, type_name)
        if self._running is not None:
            self._fresh.add(name)
            self._halted[name] = "IDLE"
        self._changed()

    def delete_block(self, name: str) -> None:
        """Deletes a block that does not run, and its connections."""
        self._drawn.expect_block(name)
        if self._halted.get(name, "RUNNING" if self.state == "RUNNING" else "IDLE") == "RUNNING":
            raise ManagementError("INVALID_STATE", f"{name} of {self.name} is RUNNING: cannot delete it")
        self._drawn.delete_block(name)
        self._halted.pop(name, None)
        self._fresh.discard(name)
        self._gone.add(name)
        for ports in (self._forced, self._watched, self._counts.counts):
            for port in [port for port in ports if port.rpartition(".")[0] == name]:
                del ports[port]
        self._changed()

    def connect(self, source: str, destination: str) -> None:
        self._drawn.connect(source, destination)
        self._changed()

    def disconnect(self, source: str, destination: str) -> None:
        self._drawn.disconnect(source, destination)
        self._changed()

    def write(self, name: str, literal: str) -> None:
        """Gives a variable a value: at once when the resource has been started, else for its start."""
        running = self._running_with(name)
        if running is None:
            self._drawn.write(name, literal)
            return
        value = value_of(literal, _found(lambda: running.type_of(name), name))
        if name in self._forced:
            return
        if self._before is not None:
            self._writes[name] = value
        else:
            _found(lambda: running.write(name, value), name)

    def read(self, name: str) -> str:
        """The value of a port, printed as FORTE does: strings without quotes, of `BLOCK.$ECC` the state's number."""
        running = self._running_with(name)
        if running is None:
            return self._drawn.read(name)
        if name.endswith(".$ECC"):
            return str(self._drawn.state_number(name, _found(lambda: running.read(name), name)))
        kind = _found(lambda: running.type_of(name), name)
        return printed(self._forced[name] if name in self._forced else _found(lambda: running.read(name), name), kind)

    def force(self, name: str, literal: str) -> None:
        """Gives a data port a value that stays, whatever is written or connected to it."""
        running = self._running_with(name)
        kind = self._drawn.type_of(name) if running is None else _found(lambda: running.type_of(name), name)
        self._forced[name] = value_of(literal, kind)
        self._changed()

    def release(self, name: str) -> None:
        """Takes back that a port is forced; it keeps the value until the next one comes."""
        self.read(name)
        self._forced.pop(name, None)
        self._changed()

    def trigger(self, event: str) -> None:
        """Lets an event happen: at an event input as if it came, at an event output for all receivers."""
        if self._running is None:
            raise ManagementError("INVALID_STATE", f"{self.name} is {self.state}: no event can happen")
        self._expect_event(event)
        self._running.trigger(event)

    def reset_count(self, event: str) -> None:
        """Lets the count of an event that is watched begin at zero."""
        self._expect_event(event)
        if event in self._counts.counts:
            self._counts.counts[event] = 0

    def watch(self, name: str) -> None:
        """Adds a data port or an event to those that `watched` reads."""
        if not self._drawn.is_event(name):
            self.read(name)
        if len(self._watched) >= WATCHES and name not in self._watched:
            raise ManagementError("OVERFLOW", f"{self.name} watches {WATCHES} ports already")
        self._watched[name] = None
        if self._drawn.is_event(name):
            self._counts.watch(name)
            self._changed()

    def unwatch(self, name: str) -> None:
        if name not in self._watched:
            raise ManagementError("NO_SUCH_OBJECT", f"{self.name} does not watch {name}")
        del self._watched[name]
        if self._counts.counts.pop(name, None) is not None:
            self._changed()

    def watched(self) -> dict[str, Watched]:
        """The values of all watched ports, as `read` prints them, and how often watched events have come."""
        counts = self._counts.counts
        return {
            name: Watched(str(counts[name]), is_event=True)
            if name in counts
            else Watched(self.read(name), name in self._forced)
            for name in self._watched
        }

    def change_block_state(self, name: str, action: RequestAction) -> None:
        """START, STOP, KILL or RESET of one block; before the resource runs only its state is noted."""
        self._drawn.expect_block(name)
        sources, target = _MOVES[action]
        state = self._halted.get(name, "RUNNING" if self._running is not None else "IDLE")
        if state not in sources:
            raise ManagementError("INVALID_STATE", f"{name} is {state}: cannot {action}")
        if self._running is None:
            self._halted[name] = target
            return
        if action == "START":
            del self._halted[name]
        else:
            self._halted[name] = target
        if action == "RESET":
            self._running.reset_block(name)
        elif action != "START" and self._before is None:
            self._running.halt_block(name)
        self._changed()

    def begin_change(self) -> None:
        """Gathers what is asked for from now on until `commit_change`; what was gathered before is forgotten."""
        if self._running is None:
            raise ManagementError("INVALID_STATE", f"{self.name} is {self.state}: nothing runs that could be changed")
        self.forget_change()
        if self._fresh or self._gone:
            raise ManagementError("NOT_READY", f"{self.name} has not taken over an earlier change yet")
        kept = dict(self._watched), dict(self._forced), dict(self._halted), dict(self._counts.counts)
        self._before, self._drawn = _Kept(self._drawn, *kept), self._drawn.copy()

    def forget_change(self) -> None:
        """Forgets what has been gathered."""
        before, self._before = self._before, None
        if before is None:
            return
        self._drawn, self._watched, self._forced, self._halted = (
            before.drawn,
            before.watched,
            before.forced,
            before.halted,
        )
        self._counts.counts.clear()
        self._counts.counts.update(before.counts)
        self._writes.clear()
        self._fresh.clear()
        self._gone.clear()

    def commit_change(self) -> None:
        """Puts in force what has been gathered, between two events; when that fails everything stays as it was.

        A block in place of one of the same name goes on in the state of that name and with the values of variables of
        the same name and type, unless it was given others. NOT_READY says that an event chain runs: ask again.
        """
        if self._before is None or self._running is None:
            raise ManagementError("INVALID_STATE", f"{self.name} has no change to put in force")
        if not self._running.is_idle:
            raise ManagementError("NOT_READY", f"{self.name} is in the middle of an event chain")
        running, before = self._running, self._before
        replaced = self._fresh & self._gone & {block.name for block in before.drawn.blocks()}
        carried, states = carried_values(running, before.drawn, self._drawn, replaced), states_of(running, replaced)
        halted = [name for name in self._halted if name in before.drawn and name not in before.halted]
        writes = dict(self._writes)
        try:
            running.change_soon(self._change)
            running.change_now()
        except FunctionBlockError as error:
            self.forget_change()
            raise ManagementError("INVALID_OPERATION", str(error)) from None
        self._before = None
        self._writes.clear()
        for name, value in (carried | writes).items():
            with suppress(FunctionBlockError):
                running.write(name, value)
        for name, state in states.items():
            with suppress(FunctionBlockError):
                running.enter_state(name, state)
        for name in halted:
            if name in self._drawn and name in self._halted:
                running.halt_block(name)

    def change_state(self, action: RequestAction) -> None:
        """START, STOP, KILL or RESET."""
        sources, target = _MOVES[action]
        if self.state not in sources:
            raise ManagementError("INVALID_STATE", f"{self.name} is {self.state}: cannot {action}")
        if action == "START":
            self._start()
        elif action == "STOP" and self._running is not None:
            self.state = target
            self._running.pause()
        else:
            self.state = target
            self.close()

    def close(self) -> None:
        """Ends what runs."""
        if self._running is not None:
            self._running.close()
            self.forget_change()
            self._running = None
            self._halted.clear()
            self._fresh.clear()

    def prepare(self) -> None:
        """Compiles what the next START runs; until then nothing else may be done to the resource.

        It may be called in another thread than everything else. Why it is impossible, START tells.
        """
        if self._running is not None or self.state != "IDLE":
            return
        try:
            self._prepared = self._compiled()
        except ManagementError as error:
            self._prepared = error

    def _start(self) -> None:
        if self._running is not None:
            self.state = "RUNNING"
            self._running.resume()
            return
        if self._prepared is None:
            self.prepare()
        prepared, self._prepared = self._prepared, None
        self._halted.clear()
        assert prepared is not None
        if isinstance(prepared, ManagementError):
            raise prepared
        self._running = prepared
        self.state = "RUNNING"
        if self._forced or self._counts.counts:
            self._changed()
        prepared.start()

    def _compiled(self) -> Running:
        try:
            running = self._launch(self.network(), self._ended)
            for name, literal in self._drawn.presets.items():
                running.write(name, value_of(literal, running.type_of(name)))
        except ToolError as error:
            raise ManagementError("INVALID_OPERATION", f"{self.name} cannot start: {error}") from None
        return running

    def _ended(self) -> None:
        self.forget_change()
        self._running = None
        self._halted.clear()
        self._fresh.clear()
        self.state = "KILLED"

    def _changed(self) -> None:
        """Lets what runs follow, before its next event, unless a change is gathered."""
        if self._running is not None and self._before is None:
            self._running.change_soon(self._change)

    def _change(self, resource: Resource) -> None:
        fresh, self._fresh, self._gone = self._fresh, set(), set()
        observers = (self._counts,) if self._counts.counts else ()
        operation = Operation(frozenset(self._halted), dict(self._forced), observers)
        resource.change(self.network(), operation, fresh)
        for name, literal in self._drawn.presets.items():
            if name.rpartition(".")[0] in fresh:
                resource.write(name, value_of(literal, resource.variable_type(name)))

    def _running_with(self, name: str) -> Running | None:
        """What runs, if it has the block in `BLOCK.PORT` by now: one just created has its first value."""
        return None if name.rpartition(".")[0] in self._fresh | self._gone else self._running

    def _expect_event(self, event: str) -> None:
        if not self._drawn.is_event(event):
            raise ManagementError("NO_SUCH_OBJECT", f"{event} is no event here")


def _found(ask: Callable[[], Any], name: str) -> Any:
    try:
        return ask()
    except FunctionBlockError as error:
        raise ManagementError("NO_SUCH_OBJECT", f"{name}: {error}") from None
