"""TRACK_ROUTER: no two vehicles on one segment, and nobody waits for ever, on the usual track and on any other."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dtwin.controller.ports import BLOCKS
from dtwin.line.file import line_of
from dtwin.line.search import Router, search
from dtwin.line.system import router_inputs, track_inputs

SEGMENTS = 60


def test_every_state_of_the_usual_zone_goes_on() -> None:
    line = line_of("default")
    zone = line.zones[0]
    goals = [zone.track.number(node) for node in ("source", "a1_dock", "a2_dock", "buffer")]
    homes = [zone.track.number(vehicle.home) for vehicle in zone.vehicles]
    found = search(router_inputs(line, 0), homes, goals)
    assert found.problem == ""
    assert found.states > 20_000


def test_both_zones_of_the_usual_line_have_the_same_track() -> None:
    line = line_of("default")
    first, second = (router_inputs(line, number) for number in range(2))
    assert first == second


@pytest.mark.parametrize(
    ("right", "wrong", "problem"),
    [
        ("IF STAGE = 3 AND ALIVE THEN", "IF STAGE = 3 THEN", "nobody can go on"),
        ("IF OWNER[P] = 0 THEN", "IF OWNER[P] >= 0 THEN", "two vehicles hold a node"),
        ("HELD[BASE + 1] <> AT DO", "HELD[BASE + COUNT[V]] <> AT DO", "not held for it"),
        ("GRANT := HELD[BASE + K];", "GRANT := 0;", "nobody can go on"),
        (
            'Destination="PASSED" Condition="REQ[NUMBER - LAST &gt; 0]"',
            'Destination="PASSED" Condition="REQ"',
            "is believed",
        ),
    ],
)
def test_the_search_finds_what_a_careless_router_does(tmp_path: Path, right: str, wrong: str, problem: str) -> None:
    texts = {name: (BLOCKS / "line" / f"{name}.fbt").read_text() for name in ("TRACK_ROUTER", "NEWEST_MESSAGE")}
    assert any(right in text for text in texts.values())
    for name, text in texts.items():
        (tmp_path / f"{name}.fbt").write_text(text.replace(right, wrong))
    line = line_of("default")
    track = line.zones[0].track
    goals = [track.number(node) for node in ("a1_dock", "a2_dock")]
    homes = [track.number(vehicle.home) for vehicle in line.zones[0].vehicles]
    assert problem in search(router_inputs(line, 0), homes, goals, blocks=tmp_path).problem


@dataclass(frozen=True)
class Drawn:
    """A drawn track: nodes from 1; a ring with ways across and docks beside it."""

    nodes: int
    ends: tuple[tuple[int, int], ...]
    homes: tuple[int, ...]
    goals: tuple[int, ...]


@st.composite
def tracks(draw: st.DrawFn) -> Drawn:
    vehicles, goals = draw(st.integers(1, 8)), draw(st.integers(2, 6))
    most = SEGMENTS - 2 * (vehicles + goals)
    ring = draw(st.integers(3, min(most, 64 - vehicles - goals)))
    ends = [(k, k % ring + 1) for k in range(1, ring + 1)]
    across = st.tuples(st.integers(1, ring), st.integers(1, ring)).filter(lambda pair: pair[0] != pair[1])
    ends += [pair for pair in draw(st.lists(across, max_size=most - ring, unique=True)) if pair not in ends]
    docks = range(ring + 1, ring + 1 + vehicles + goals)
    for dock in docks:
        node = draw(st.integers(1, ring))
        ends += [(node, dock), (dock, node)]
    return Drawn(ring + len(docks), tuple(ends), tuple(docks[:vehicles]), tuple(docks[vehicles:]))


class Driven:
    """Vehicles that ask, drive and get goals in any order; some answers are lost, and what they told comes again."""

    def __init__(self, track: Drawn, seed: int) -> None:
        self.track = track
        self.restart()
        self.held = [[home] for home in track.homes]
        self.goals = list(track.homes)
        self._generator = np.random.default_rng(seed)
        self._told: list[tuple[int, int, int, int]] = []

    def restart(self) -> None:
        """Puts a router in its place that knows nothing of the vehicles."""
        track = self.track
        self.router = Router(track_inputs(track.nodes, track.ends, {*track.homes, *track.goals}, track.homes))

    def step(self, vehicle: int) -> bool:
        """One vehicle drives on to the next node that it was given, or asks; whether anything changed."""
        held = self.held[vehicle]
        if len(held) > 1 and self._generator.random() < 0.5:
            held.pop(0)
            return True
        node = self.router.ask(vehicle, held[0], self.goals[vehicle], held[-1])
        self._told.append((vehicle, held[0], self.goals[vehicle], held[-1]))
        late = self._told[int(self._generator.integers(len(self._told)))]
        assert self.router.drops(*late, age=int(self._generator.integers(3)))
        if node and self._generator.random() < 0.1:
            return True
        if node:
            assert (held[-1], node) in self.track.ends
            held.append(node)
        standing = [node for nodes in self.held for node in nodes]
        assert len(set(standing)) == len(standing), "two vehicles hold a node"
        return bool(node) or len(held) > 1

    def wander(self, steps: int) -> None:
        """Vehicles that rest at their goals get others, in any order."""
        for vehicle in self._generator.integers(len(self.held), size=steps).tolist():
            if self.held[vehicle] == [self.goals[vehicle]]:
                self.goals[vehicle] = int(self._generator.choice([*self.track.goals, self.track.homes[vehicle]]))
            self.step(vehicle)

    def settle(self, goals: Sequence[int]) -> None:
        """Everybody comes to its goal, and goes home then, as vehicles do whose order is carried out."""
        self.goals = list(goals)
        served: set[int] = set()
        for _ in range(400 * len(self.held)):
            for vehicle, goal in enumerate(goals):
                if self.held[vehicle] == [goal]:
                    served.add(vehicle)
                if vehicle in served:
                    self.goals[vehicle] = self.track.homes[vehicle]
                self.step(vehicle)
            if len(served) == len(goals):
                return
        raise AssertionError(f"{served} of {len(goals)} came to their goals")


def everybody_comes_to_its_goal(track: Drawn, seed: int) -> None:
    driven = Driven(track, seed)
    driven.wander(400)
    generator = np.random.default_rng(seed + 1)
    driven.settle([int(goal) for goal in generator.choice(track.goals, size=len(track.homes))])
    driven.settle(track.homes)


@settings(max_examples=25, deadline=None)
@given(track=tracks(), seed=st.integers(0, 2**32 - 1))
def test_on_any_track_everybody_comes_to_its_goal(track: Drawn, seed: int) -> None:
    everybody_comes_to_its_goal(track, seed)


@settings(max_examples=15, deadline=None)
@given(track=tracks(), seed=st.integers(0, 2**32 - 1))
def test_a_router_that_begins_anew_finds_the_vehicles_where_they_are(track: Drawn, seed: int) -> None:
    driven = Driven(track, seed)
    for again in range(3):
        driven.wander(100 + 37 * again)
        driven.restart()
    driven.settle(track.homes)


@pytest.mark.thorough
@settings(max_examples=1500, deadline=None)
@given(track=tracks(), seed=st.integers(0, 2**32 - 1))
def test_on_many_tracks_everybody_comes_to_its_goal(track: Drawn, seed: int) -> None:
    everybody_comes_to_its_goal(track, seed)
