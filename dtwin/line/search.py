"""The block TRACK_ROUTER searched: every state that vehicles can bring it to, and what may not be among them.

A vehicle asks, is given a node or not, and reaches the nodes that it was given one after the other; at rest at its
goal it may get any other one. In which order all this happens is free.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from dtwin.controller.ports import BLOCKS
from dtwin.controller.runtime import Blocks, running
from dtwin.errors import DtwinError
from iec61499.library import Library
from iec61499.model import Block, Connection, FBNetwork, Parameter
from iec61499.native.resource import NativeResource

_ROUTER: Final = "ROUTER"
_VEHICLES: Final = 8
"""Number of vehicles that the block can serve."""
_MEMORY: Final = {"OWNER": 64, "TARGET": 8, "FIRST": 1}
"""Variables that its further answers depend on, and how many DINT each has."""


class Router:
    """The block alone, with a SERVER for each vehicle.

    Args:
        inputs: values of its inputs, see `track_inputs`.
        blocks: folder of the function-block library.
    """

    def __init__(self, inputs: Mapping[str, Any], blocks: Path = BLOCKS) -> None:
        drawn = [Block("START", "E_RESTART"), Block(_ROUTER, "TRACK_ROUTER")]
        events, data = [Connection("START.COLD", f"{_ROUTER}.INIT")], []
        for k in range(1, _VEHICLES + 1):
            ends = (Parameter("QI", "TRUE"), Parameter("ID", f"'localhost:{61700 + k}'"))
            drawn.append(Block(f"V{k}", "SERVER_1_3", ends))
            events += [
                Connection("START.COLD", f"V{k}.INIT"),
                Connection(f"V{k}.IND", f"{_ROUTER}.REQ{k}"),
                Connection(f"{_ROUTER}.CNF{k}", f"V{k}.RSP"),
            ]
            data += [
                Connection(f"V{k}.RD_1", f"{_ROUTER}.AT{k}"),
                Connection(f"V{k}.RD_2", f"{_ROUTER}.GOAL{k}"),
                Connection(f"V{k}.RD_3", f"{_ROUTER}.STANDING{k}"),
                Connection(f"{_ROUTER}.NEXT{k}", f"V{k}.SD_1"),
            ]
        self.resource: Blocks = running(FBNetwork(tuple(drawn), (), tuple(events), tuple(data)), Library([blocks]))
        self._servers = [self.resource.server(f"V{k}") for k in range(1, _VEHICLES + 1)]
        for name, value in inputs.items():
            self.resource.write(f"{_ROUTER}.{name}", value)
        self._parts = []
        if isinstance(self.resource, NativeResource):
            places = {name: self.resource.offset(f"{_ROUTER}.{name}") for name in _MEMORY}
            self._parts = [slice(places[name], places[name] + 4 * size) for name, size in _MEMORY.items()]
        self.resource.start()

    def ask(self, vehicle: int, at: int, goal: int, standing: bool = True) -> int:
        """The node that is given to a vehicle (from 0) at a node with a goal; 0 for none.

        Args:
            vehicle: its number.
            at: last node that it has reached.
            goal: where it wants to go.
            standing: whether it was given no node beyond that.
        """
        (node,) = self._servers[vehicle].exchange((at, goal, standing))
        return int(node)

    def state(self) -> tuple[object, object]:
        """What its further answers depend on, beside where the vehicles are; and all of its state, to restore it."""
        snapshot = self.resource.snapshot()
        if isinstance(snapshot, bytes):
            return tuple(snapshot[part] for part in self._parts), snapshot
        return tuple(map(str, (self.resource.read(f"{_ROUTER}.{name}") for name in _MEMORY))), snapshot


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

    What is looked for: a node that two vehicles hold; a state in which no vehicle that is not at its goal can ever
    go on, though no other one stands where it wants to go; a way to go round for ever while nobody gets a new goal.

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
        if problem := _shared(vehicles):
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
    memory: object
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
            node = router.ask(k, held[0], goal, len(held) == 1)
            after = with_vehicle((*held, node) if node else held, goal)
            yield False, State(after, *router.state())


def _shared(vehicles: Vehicles) -> str:
    held = [node for nodes, _ in vehicles for node in nodes]
    return f"two vehicles hold a node: {vehicles}" if len(set(held)) < len(held) else ""


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
