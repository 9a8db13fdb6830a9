"""The block TRACK_ROUTER searched: every state that vehicles can bring it to, and what may not be among them.

A vehicle asks, is given a node or not, and reaches the nodes that it was given one after the other; at rest at its
goal it may get any other one. An answer may be lost, and what a vehicle has told before may come again at any time.
In which order all this happens is free.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from dtwin.controller.ports import BLOCKS
from dtwin.controller.runtime import Blocks, running
from dtwin.errors import DtwinError
from iec61499.errors import CommunicationError
from iec61499.library import Library
from iec61499.model import Block, Connection, FBNetwork, Parameter
from iec61499.native.resource import NativeResource

_ROUTER: Final = "ROUTER"
_VEHICLES: Final = 8
"""Number of vehicles that the block can serve."""
_APART: Final = 5
"""In a state a vehicle has told before that it was at every so many-th node."""
_ROW: Final = 64
"""Room for the nodes that a vehicle holds, in HELD."""
_MEMORY: Final = {"OWNER": 64, "TARGET": 8, "COUNT": 8, "FIRST": 1, "UNKNOWN": 1}
"""Variables that its further answers depend on, beside the nodes that vehicles hold, and how many DINT each has."""


class Memory(NamedTuple):
    """What the block knows.

    Attributes:
        held: the nodes that each vehicle holds for it, in their order.
        others: values of its other variables.
    """

    held: tuple[tuple[int, ...], ...]
    others: tuple[tuple[int, ...], ...]


class Router:
    """The block alone, with a SERVER for each vehicle, and a NEWEST_MESSAGE that drops what it has told before.

    Args:
        inputs: values of its inputs, see `track_inputs`.
        blocks: folder of the function-block library.
    """

    def __init__(self, inputs: Mapping[str, Any], blocks: Path = BLOCKS) -> None:
        drawn = [Block("START", "E_RESTART"), Block(_ROUTER, "TRACK_ROUTER")]
        events, data = [Connection("START.COLD", f"{_ROUTER}.INIT")], []
        for k in range(1, _VEHICLES + 1):
            ends = (Parameter("QI", "TRUE"), Parameter("ID", f"'localhost:{61700 + k}'"))
            drawn += [Block(f"V{k}", "SERVER_2_4", ends), Block(f"N{k}", "NEWEST_MESSAGE")]
            events += [
                Connection("START.COLD", f"V{k}.INIT"),
                Connection("START.COLD", f"N{k}.INIT"),
                Connection(f"N{k}.INITO", f"N{k}.OWN"),
                Connection(f"V{k}.IND", f"N{k}.REQ"),
                Connection(f"N{k}.CNF", f"{_ROUTER}.REQ{k}"),
                Connection(f"{_ROUTER}.CNF{k}", f"V{k}.RSP"),
            ]
            inside = {"OUT1": f"AT{k}", "OUT2": f"BASE_END{k}", "OUT3": f"GOAL{k}"}
            into = ("NUMBER", "IN1", "IN2", "IN3")
            data += [Connection(f"V{k}.RD_{n}", f"N{k}.{name}") for n, name in enumerate(into, 1)]
            data += [Connection(f"N{k}.{out}", f"{_ROUTER}.{name}") for out, name in inside.items()]
            data += [Connection(f"{_ROUTER}.NEXT{k}", f"V{k}.SD_1"), Connection(f"N{k}.NEWEST", f"V{k}.SD_2")]
        self.resource: Blocks = running(FBNetwork(tuple(drawn), (), tuple(events), tuple(data)), Library([blocks]))
        self._servers = [self.resource.server(f"V{k}") for k in range(1, _VEHICLES + 1)]
        for name, value in inputs.items():
            self.resource.write(f"{_ROUTER}.{name}", value)
        self._vehicles = int(inputs["VEHICLES"])
        self._places: dict[str, int] = {}
        if isinstance(self.resource, NativeResource):
            self._places = {name: self.resource.offset(f"{_ROUTER}.{name}") for name in (*_MEMORY, "HELD")}
        self.resource.start()

    def ask(self, vehicle: int, at: int, goal: int, base_end: int | None = None) -> int:
        """The node that is given to a vehicle (from 0) at a node with a goal; 0 for none.

        Args:
            vehicle: its number.
            at: last node that it has reached.
            goal: where it wants to go.
            base_end: last node that it was given; None for the one that it has reached.
        """
        number = int(self.resource.read(f"N{vehicle + 1}.NEWEST")) + 1
        told = number, at, at if base_end is None else base_end, goal
        node, answer = self._servers[vehicle].exchange(told)
        if answer != number:
            raise DtwinError(f"answer to vehicle {vehicle}: expected number {number}, got {answer}")
        return int(node)

    def drops(self, vehicle: int, at: int, goal: int, base_end: int, age: int = 0) -> bool:
        """Whether there is no answer to what a vehicle has told before.

        Args:
            vehicle: its number, from 0.
            at, goal, base_end: see `ask`.
            age: how many it has told since.
        """
        number = int(self.resource.read(f"N{vehicle + 1}.NEWEST")) - age
        try:
            self._servers[vehicle].exchange((number, at, base_end, goal))
        except CommunicationError:
            return True
        return False

    def state(self) -> tuple[Memory, object]:
        """What its further answers depend on, beside where the vehicles are; and all of its state, to restore it."""
        snapshot = self.resource.snapshot()
        numbers = {name: self._numbers(snapshot, name, size) for name, size in _MEMORY.items()}
        held = self._numbers(snapshot, "HELD", _ROW * self._vehicles)
        rows = tuple(held[_ROW * k : _ROW * k + numbers["COUNT"][k]] for k in range(self._vehicles))
        return Memory(rows, tuple(numbers.values())), snapshot

    def _numbers(self, snapshot: object, name: str, size: int) -> tuple[int, ...]:
        """The first values of an array of the block, or one value."""
        if isinstance(snapshot, bytes):
            return struct.unpack_from(f"={size}i", snapshot, self._places[name])
        value = self.resource.read(f"{_ROUTER}.{name}")
        return tuple(value[:size]) if isinstance(value, list | tuple) else (int(value),)


@dataclass(frozen=True, slots=True)
class Found:
    """What a search has found.

    Attributes:
        states: number of different states.
        steps: number of steps between them.
        problem: what is wrong, "" for nothing.
    """

    states: int
    steps: int
    problem: str


Vehicles = tuple[tuple[tuple[int, ...], int], ...]
"""For every vehicle the nodes that it holds, the one that it has reached first, and its goal."""


def search(
    inputs: Mapping[str, Any],
    homes: Sequence[int],
    goals: Sequence[int],
    ahead: int = 1,
    most: int = 2_000_000,
    blocks: Path = BLOCKS,
) -> Found:
    """Visits every state of TRACK_ROUTER with vehicles that begin at home.

    What is looked for: a node that two vehicles hold, or one that the block does not hold for its vehicle; a state in
    which no vehicle that is not at its goal can ever go on, though no other one stands where it wants to go; a way to
    go round for ever while nobody gets a new goal; an effect of what a vehicle told before, wherever it was then.

    Args:
        inputs: values of the inputs of the block.
        homes: docks at which the vehicles begin.
        goals: docks to which any vehicle may be sent, beside its home.
        ahead: number of nodes that a vehicle asks for beyond the one that it has reached.
        most: largest number of states.
        blocks: folder of the function-block library.

    Raises:
        DtwinError: there are more states.
    """
    router = Router(inputs, blocks)
    nodes = range(1, int(inputs["NODES"]) + 1)
    for k, home in enumerate(homes):
        router.ask(k, home, home)
    first: Vehicles = tuple(((home,), home) for home in homes)
    start = State(first, *router.state())
    numbers = {start.key: 0}
    waiting = [start]
    moves: list[list[int]] = [[]]
    steps = 0
    while waiting:
        state = waiting.pop()
        vehicles, own = state.vehicles, numbers[state.key]
        if (
            problem := _shared(vehicles)
            or _unheld(vehicles, state.memory)
            or _believed(router, state, nodes[own % _APART :: _APART])
        ):
            return Found(len(numbers), steps, problem)
        for is_goal, after in _steps(router, state, homes, goals, ahead):
            steps += 1
            if after.key == state.key:
                continue
            if after.key not in numbers:
                if len(numbers) >= most:
                    raise DtwinError(f"search: more than {most} states")
                numbers[after.key] = len(numbers)
                moves.append([])
                waiting.append(after)
            if not is_goal:
                moves[own].append(numbers[after.key])
        if not moves[own] and (problem := _stuck(vehicles)):
            return Found(len(numbers), steps, problem)
    return Found(len(numbers), steps, "a way goes round for ever" if _has_circle(moves) else "")


class State(NamedTuple):
    """A state of vehicles and block.

    Attributes:
        vehicles: where the vehicles are, and want to go.
        memory: what the block knows.
        snapshot: to make the block know it.
    """

    vehicles: Vehicles
    memory: Memory
    snapshot: object

    @property
    def key(self) -> tuple[object, ...]:
        """What tells it from others."""
        return self.vehicles, self.memory


def _steps(
    router: Router, state: State, homes: Sequence[int], goals: Sequence[int], ahead: int
) -> Iterator[tuple[bool, State]]:
    """The states that may follow, and whether one follows by a new goal."""
    vehicles, memory, snapshot = state
    blocks = router.resource
    for k, (held, goal) in enumerate(vehicles):

        def with_vehicle(held: tuple[int, ...], goal: int, k: int = k) -> Vehicles:
            return (*vehicles[:k], (held, goal), *vehicles[k + 1 :])

        if len(held) > 1:
            yield False, State(with_vehicle(held[1:], goal), memory, snapshot)
        elif held[0] == goal:
            for other in (*goals, homes[k]):
                if other != goal:
                    yield True, State(with_vehicle(held, other), memory, snapshot)
        if len(held) <= ahead:
            blocks.restore(snapshot)
            node = router.ask(k, held[0], goal, held[-1])
            own = router.state()
            yield False, State(with_vehicle((*held, node) if node else held, goal), *own)
            if node:
                yield False, State(vehicles, *own)  # the answer is lost


def _shared(vehicles: Vehicles) -> str:
    held = [node for nodes, _ in vehicles for node in nodes]
    return f"two vehicles hold a node: {vehicles}" if len(set(held)) < len(held) else ""


def _unheld(vehicles: Vehicles, memory: Memory) -> str:
    """What is wrong when a vehicle may drive where the block holds nothing for it."""
    if all(set(held) <= set(row) for (held, _), row in zip(vehicles, memory.held, strict=True)):
        return ""
    return f"a vehicle holds a node that is not held for it: {vehicles}, {memory.held}"


def _believed(router: Router, state: State, nodes: Sequence[int]) -> str:
    """What is wrong when something happens because of what a vehicle has told before."""
    vehicles, memory, snapshot = state
    router.resource.restore(snapshot)
    for k, (_, goal) in enumerate(vehicles):
        for node in nodes:
            if not router.drops(k, node, goal, node, node % 3) or router.state()[0] != memory:
                return f"vehicle {k} is believed what it told before at node {node}: {vehicles}"
    return ""


def _stuck(vehicles: Vehicles) -> str:
    """What is wrong when nobody can go on: somebody stands for no reason."""
    resting = {goal for held, goal in vehicles if held == (goal,)}
    for held, goal in vehicles:
        if held != (goal,) and goal not in resting:
            return f"nobody can go on: {vehicles}"
    return ""


def _has_circle(moves: Sequence[Sequence[int]]) -> bool:
    """Whether steps lead back to where they began (depth-first search)."""
    colour = bytearray(len(moves))
    for start in range(len(moves)):
        if colour[start]:
            continue
        stack = [(start, iter(moves[start]))]
        colour[start] = 1
        while stack:
            node, rest = stack[-1]
            following = next(rest, None)
            if following is None:
                colour[node] = 2
                stack.pop()
            elif colour[following] == 1:
                return True
            elif not colour[following]:
                colour[following] = 1
                stack.append((following, iter(moves[following])))
    return False
