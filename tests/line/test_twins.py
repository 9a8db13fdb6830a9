"""Twins of stations, of zones and of the line: what an arm can still do, and which way to share work out is best."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from dtwin.bus.line.plant import FlowQuestion, SetUpFlow
from dtwin.line.file import line_of
from dtwin.line.line import Assignment, Line
from dtwin.line.run import LineRun, LineSettings
from dtwin.line.station import FREE, EmulatedStation
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.decisions import Decision
from dtwin.line.twins.forward import SOON
from dtwin.line.twins.node import NodeTwin
from dtwin.line.twins.overall import Choice, OverallTwin, predicted
from dtwin.line.twins.rehearsal import AWAY, expected_deviation, rehearsed
from dtwin.line.twins.reorganisation import LOOKS, Doors, Reorganisation
from dtwin.line.twins.zone import AHEAD, HOUR, ZoneTwin, best_first
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.monitoring.verdict import Finding, finding

LINE = line_of("default")
PLAN = LINE.stations[0]


def found(fault: str, size: float = 0.0) -> Finding:
    return finding(parse_fault_id(fault), 1.0, 1.5, size)


@pytest.mark.parametrize(
    ("fault", "size", "ability"),
    [
        ("K2", -0.9, "nothing"),
        ("K2", -0.05, "all"),
        ("lock1", 0.0, "nothing"),
        ("freeze2", 0.0, "nothing"),
        ("payload", 0.01, "all"),
        ("push", 0.0, "all"),
    ],
)
def test_what_an_arm_can_still_do(fault: str, size: float, ability: str) -> None:
    twin = NodeTwin(PLAN, LINE.source)
    capability = twin.judged(found(fault, size))
    assert capability.ability == ability
    assert bool(capability.places) == (ability == "all")


def test_with_less_torque_an_arm_loses_places_before_it_loses_all() -> None:
    twin = NodeTwin(PLAN, LINE.source)
    places = [set(twin.judged(found("K1", -0.01 * share)).places) for share in (0, 20, 40, 55, 70, 99)]
    assert all(later <= earlier for earlier, later in itertools.pairwise(places))
    assert places[0] == {"blue", "red", "green"}
    assert places[-1] == set()


def test_a_twin_knows_nothing_of_the_machine_that_its_arm_is() -> None:
    one, other = NodeTwin(PLAN, LINE.source), NodeTwin(replace(PLAN, machine="905511"), LINE.source)
    assert other.times == one.times
    for share in (5, 30, 90):
        fault = found("K1", -0.01 * share)
        assert other.judged(fault) == one.judged(fault)


class Told(ZoneTwin):
    """A zone whose rate for a number of operations is told, and whose first station may have failed."""

    def __init__(self, line: Line, number: int, rates: dict[int, float], fails: str = "") -> None:
        super().__init__(line, number, {s.name: NodeTwin(s, LINE.source) for s in line.stations})
        self._rates = rates
        if fails:
            self._nodes[fails].stopped("it fails")

    def rate(self, assignment: object) -> float:
        assert isinstance(assignment, dict)
        return self._rates[len(assignment)]


def test_the_twin_of_the_line_takes_the_way_whose_slowest_zone_is_fastest() -> None:
    first = Told(LINE, 0, {1: 140.0, 2: 90.0, 3: 60.0}, fails="a2")
    second = Told(LINE, 1, {1: 130.0, 2: 120.0, 3: 95.0})
    choice = OverallTwin(LINE, [first, second]).choose(LINE.assignment)
    assert choice is not None
    assert choice.rate == 95.0
    assert choice.assignment == {"deburr": "a1", "mark": "b1", "test": "b1", "pack": "b2"}


class Charging(Told):
    """A zone whose vehicles charge within an hour, so that it lets fewer boxes through, but with a1 alone."""

    loss = 20.0
    """By how many boxes an hour."""

    def flows(self, question: FlowQuestion) -> list[SetUpFlow]:
        ways = self.assignments(question.operations)
        flows = [SetUpFlow(way, self._after(way, question.ahead)) for way in ways]
        return sorted(flows, key=lambda flow: -flow.rate)[: question.ways]

    def _after(self, way: dict[str, str], ahead: float) -> float:
        charge = ahead > AHEAD and set(way.values()) != {"a1"}
        return self._rates[len(way)] - len(set(way.values()) - {"a2"}) * 0.1 - self.loss * charge


def test_a_new_set_up_is_looked_at_again_for_an_hour_ahead() -> None:
    charging = Charging(LINE, 0, {1: 150.0, 2: 140.0, 3: 60.0})
    zones = [charging, Told(LINE, 1, {1: 150.0, 2: 141.0, 3: 60.0}, "b2")]
    time, decided, in_force = 100.0, list[Decision](), list[Assignment]()

    def set_up(way: Assignment) -> bool:
        in_force.append(dict(way))
        return True

    doors = Doors(set_up, lambda: time, decided.append)
    work = Reorganisation(LINE, "act", zones, doors)
    work.reconsider("b2 can do nothing", "b2")
    assert in_force == [{"deburr": "a2", "mark": "a2", "test": "b1", "pack": "b1"}], "the best for a while"
    time = 100.0 + LOOKS[0] - 1.0
    work.retry()
    assert len(in_force) == 1
    time += 1.0
    work.retry()
    assert in_force[1:] == [{"deburr": "a1", "mark": "a1", "test": "b1", "pack": "b1"}], "the best for an hour"
    assert [(each.time, each.what, each.station) for each in decided] == [
        (100.0, "set-up", "b2"),
        (130.0, "set-up", "b2"),
    ]
    charging.loss = -20.0  # as its twin knows by then
    time += LOOKS[1] - 1.0
    work.retry()
    assert len(in_force) == 2
    time += 1.0
    work.retry()
    assert [set(way.values()) for way in in_force[2:]] == [{"a1", "a2", "b1"}], "the best as is known by then"
    assert decided[-1].time == 100.0 + sum(LOOKS)
    charging.loss = 20.0
    time += 1000.0
    work.retry()
    assert len(in_force) == 3, "a third look is the last one"


@pytest.mark.parametrize("seconds", [3, 30])
def test_zones_that_refuse_what_is_best_have_a_moment_until_the_next_best_is_done(seconds: int) -> None:
    zones = [Told(LINE, 0, {1: 150.0, 2: 140.0, 3: 60.0}), Told(LINE, 1, {1: 150.0, 2: 130.0, 3: 60.0}, "b2")]
    time, decided, asked = 100.0, list[Decision](), list[Assignment]()

    def set_up(way: Assignment) -> bool:
        asked.append(dict(way))
        return way != asked[0] or time >= 100.0 + seconds

    work = Reorganisation(LINE, "act", zones, Doors(set_up, lambda: time, decided.append))
    work.reconsider("b2 can do nothing", "b2")
    assert work.version == 0
    while work.version == 0 and time < 120.0:
        time += 1.0
        work.retry()
    assert time == (103.0 if seconds == 3 else 100.0 + SOON)
    assert (work.assignment == asked[0]) == (seconds == 3)
    assert [each.what for each in decided] == ["set-up"]
    version = work.version
    time += 1.0
    work.retry()
    assert work.version == version, "what was taken is not asked for again"


@pytest.mark.parametrize(("first", "count"), [(Charging, 2), (Told, 1)])
def test_twins_that_propose_propose_what_a_second_look_finds_only_if_it_is_something_else(
    first: type[Told], count: int
) -> None:
    zones = [first(LINE, 0, {1: 150.0, 2: 140.0, 3: 60.0}), Told(LINE, 1, {1: 150.0, 2: 141.0, 3: 60.0}, "b2")]
    times, proposed = iter((100.0, 100.0, 100.0 + LOOKS[0])), list[Assignment]()

    def propose(choice: Choice, why: str) -> None:
        proposed.append(choice.assignment)

    doors = Doors(lambda way: False, lambda: next(times, 200.0), lambda decision: None, propose)
    work = Reorganisation(LINE, "propose", zones, doors)
    work.reconsider("b2 can do nothing", "b2")
    assert len(proposed) == 1
    work.retry()
    assert len(proposed) == len({tuple(way.values()) for way in proposed}) == count
    assert work.assignment == LINE.assignment


def test_nothing_is_chosen_when_no_station_is_left() -> None:
    zone = Told(LINE, 0, {1: 1.0, 2: 1.0, 3: 1.0}, fails="a1")
    zone._nodes["a2"].stopped("it fails, too")
    other = Told(LINE, 1, {1: 1.0, 2: 1.0, 3: 1.0})
    assert OverallTwin(LINE, [zone, other]).choose(LINE.assignment) is None
    assert not zone.flows(FlowQuestion(("deburr",), {}))


def test_of_ways_that_are_alike_the_one_with_fewest_changes_is_taken() -> None:
    zone = Told(LINE, 0, {2: 100.0})
    now = {"deburr": "a2", "mark": "a1"}
    assert zone.flows(FlowQuestion(("deburr", "mark"), now)) == [SetUpFlow(now, 100.0)]


@pytest.mark.parametrize(("ahead", "stays"), [(AHEAD, False), (HOUR, True)])
def test_the_line_changes_nothing_for_less_than_its_twins_tell_apart(ahead: float, stays: bool) -> None:
    zones = [Told(LINE, 0, {1: 150.0, 2: 140.0, 3: 60.0}), Told(LINE, 1, {1: 150.0, 2: 99.2, 3: 100.0})]
    choice = OverallTwin(LINE, zones).choose(LINE.assignment, ahead=ahead)
    assert choice is not None
    assert (choice.assignment == LINE.assignment) == stays
    assert choice.rate == (99.2 if stays else 100.0)


def test_as_many_ways_are_told_as_are_asked_for_and_near_the_best() -> None:
    flows = [SetUpFlow({"mark": f"a{number}"}, rate) for number, rate in enumerate((100.0, 99.2, 91.0, 89.0), 1)]
    told = [
        [flow.rate for flow in best_first(flows, FlowQuestion(("mark",), {"mark": "a2"}, ahead=ahead, ways=ways))]
        for ahead, ways in ((AHEAD, 1), (HOUR, 1), (AHEAD, 3), (HOUR, 3))
    ]
    assert told == [[100.0], [99.2], [100.0, 99.2, 91.0], [99.2, 100.0, 91.0]]
    assert not best_first((), FlowQuestion((), {}))


def test_a_rehearsal_takes_as_long_as_the_arm_does() -> None:
    times = rehearsed(PLAN)
    assert set(times.carry) == set(times.back) == {"blue", "red", "green"}
    assert 0.4 < times.grip < 0.6
    assert all(2.5 < time < 4.0 for time in times.carry.values())
    assert all(2.0 < time < 4.0 for time in times.back.values())


def test_an_arm_that_is_farther_from_its_path_than_a_healthy_one_is_looked_into(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(NodeTwin, "judged", lambda node, *_: node.capability)
    source = replace(LINE.source, lightest=0.1, masses=(0.1, 0.21))
    station, twin = EmulatedStation(replace(PLAN, faults=("K2*=0.75@80",))), NodeTwin(PLAN, source)
    told, since = list[str](), (5000, 6500, 8200)
    for ticks in since:
        station.advance(ticks - len(station.log))
        station.give("bring", 0.1, "blue")
        for _ in range(16):
            report = station.advance(50)
            told += [found.text() for found in twin.watch(station.log, report.arm, mass=0.1)]
        assert report.arm == FREE
    seen = station.log.since(0)
    away, begins = np.abs(seen.stack("target") - seen.stack("measured")), since[2]
    assert (away[5000:8000].max(axis=0) <= 1.01 * expected_deviation(PLAN, (0.1, 0.2))).all()
    assert (away[begins:].max(axis=0) <= AWAY).all()
    assert [text.partition(",")[0] for text in told] == ["voltage constant of joint 2"]


@pytest.mark.thorough
def test_the_line_lets_through_what_its_twins_predict() -> None:
    run = LineRun(LINE, LineSettings(duration=600.0, twins="off"))
    run.run()
    times = {station.name: rehearsed(PLAN) for station in LINE.stations}
    assert run.rate(150.0) == pytest.approx(predicted(LINE, times, LINE.assignment, 450.0), rel=0.03)


class Fed:
    """A zone with two ways to do two operations; with the boxes of the slower one the next zone does more."""

    def __init__(self, name: str, station: str, other: str, flows: dict[str, float]) -> None:
        self.name, self.stations = name, (station, other)
        self._flows = flows

    def capability(self, station: str) -> Capability:
        return Capability("all", (), "")

    def flows(self, question: FlowQuestion) -> list[SetUpFlow]:
        more = 10.0 if question.arrivals == ((2.0, 0),) else 0.0
        flows = [
            SetUpFlow(dict.fromkeys(question.operations, station), rate + more, ((float(number), 0),))
            for number, (station, rate) in enumerate(self._flows.items(), 1)
        ]
        return best_first(flows, question) if len(question.operations) == 2 else []

    def rate(self, assignment: Assignment) -> float:
        return 0.0


@pytest.mark.parametrize(("ahead", "first"), [(AHEAD, "a1"), (HOUR, "a2")])
def test_a_second_look_takes_the_way_of_a_zone_that_is_best_for_the_line(ahead: float, first: str) -> None:
    zones = [Fed("a", "a1", "a2", {"a1": 100.0, "a2": 99.0}), Fed("b", "b1", "b2", {"b1": 80.0, "b2": 70.0})]
    choice = OverallTwin(LINE, zones).choose(LINE.assignment, ahead=ahead)
    assert choice is not None
    assert choice.assignment["deburr"] == first
    assert choice.rate == (90.0 if first == "a2" else 80.0)
