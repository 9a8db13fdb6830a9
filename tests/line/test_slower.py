"""An arm of a line that has changed and works on: with a model of what it has become, and more time if need be."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtwin.bus.line.plant import ArmSettings, FlowQuestion
from dtwin.errors import DtwinError
from dtwin.line.file import line_of
from dtwin.line.run import LineRun, LineSettings
from dtwin.line.station import FREE, HOLDING, EmulatedStation, Input, WorkTimes, settings_text
from dtwin.line.stations import replayed
from dtwin.line.twins import zone
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.decisions import Decision, Mode
from dtwin.line.twins.guard import Guard, Hands
from dtwin.line.twins.node import NodeTwin
from dtwin.line.twins.rehearsal import rehearsed, rehearsed_anew
from dtwin.line.twins.zone import ZoneTwin
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.monitoring.verdict import Finding, finding
from dtwin.parameters import ArmParameters
from evidence.line.best import slowed
from evidence.line.otherwise import Otherwise

LINE = line_of("default")
PLAN = LINE.stations[1]
HEALTHY = ArmParameters()


def found(fault: str, size: float) -> Finding:
    return finding(parse_fault_id(fault), 1.0, 1.5, size)


def twin() -> NodeTwin:
    return NodeTwin(PLAN, LINE.source)


def test_an_arm_with_more_friction_works_on_at_a_longer_target_time() -> None:
    able = twin().judged(found("D2", 5.0 * HEALTHY.get("D2")))
    assert (able.ability, set(able.places)) == ("slower", {"blue", "red", "green"})
    assert isinstance(able.settings, ArmSettings)
    assert able.settings.target_time > 2.0
    assert able.settings.model.get("D2") == pytest.approx(6.0 * HEALTHY.get("D2"))
    assert able.times is not None
    assert able.times.carry["red"] > rehearsed(PLAN).carry["red"] + 0.2
    assert "instead of 5.6 s" in able.why


def test_an_arm_that_does_not_work_everywhere_works_as_fast_as_it_can_where_its_boxes_belong() -> None:
    source = Otherwise(light=0.1).applied(LINE).source
    weak = found("K1", -0.65)
    most, now = (NodeTwin(PLAN, source).judged(weak, needed) for needed in ((), ("blue",)))
    assert (most.ability, now.ability) == ("some places", "some places")
    assert {place for place, _ in now.lighter} == {"blue"} < {place for place, _ in most.lighter}
    assert isinstance(most.settings, ArmSettings)
    assert isinstance(now.settings, ArmSettings)
    assert now.settings.target_time < most.settings.target_time
    assert NodeTwin(PLAN, source).judged(weak, ("green",)) == most, "there it works at no speed"


def test_a_size_counts_relative_to_a_motors_constant_and_as_it_is_for_friction() -> None:
    weak, stiff = twin().judged(found("K3", -0.5)), twin().judged(found("D3", 0.1))
    assert isinstance(weak.settings, ArmSettings)
    assert isinstance(stiff.settings, ArmSettings)
    assert weak.settings.model.get("K3") == pytest.approx(0.5 * HEALTHY.get("K3"))
    assert stiff.settings.model.get("D3") == pytest.approx(HEALTHY.get("D3") + 0.1)
    assert (weak.ability, weak.settings.target_time) == ("all", 2.0), "a model of it is all that it needs"
    supply = twin().judged(found("supply", -0.1))
    assert isinstance(supply.settings, ArmSettings)
    assert supply.settings.model.voltage_constant == pytest.approx(0.9 * np.array(HEALTHY.voltage_constant))


def test_what_an_arm_took_tells_nothing_of_settings_that_are_still_to_come() -> None:
    node, station = twin(), EmulatedStation(PLAN)
    station.advance(500)
    for _ in range(3):
        station.give("bring", 0.2, "red")
        for _ in range(30):
            node.watch(station.log, station.advance(30).arm)
    before = node.times
    node.capability = able = node.judged(found("D2", 5.0 * HEALTHY.get("D2")))
    assert able.times is not None
    assert node.times == able.times
    assert node.times.carry["red"] > before.carry["red"] + 0.2


def test_no_settings_are_tried_beyond_their_bounds() -> None:
    assert rehearsed_anew(PLAN, HEALTHY.with_values({"D1": 50.0}), (0.2,), (("red", 0.21),)) is None


def test_the_twin_of_a_zone_reckons_with_an_arm_that_is_slower() -> None:
    nodes = {station.name: NodeTwin(station, LINE.source) for station in LINE.zones[0].stations}
    both = ZoneTwin(LINE, 0, nodes)
    shared, moved = {"deburr": "a1", "mark": "a2"}, {"deburr": "a1", "mark": "a1"}
    assert both.rate(shared) > 1.05 * both.rate(moved)
    usual = rehearsed(PLAN)
    slow = WorkTimes(usual.grip, dict.fromkeys(usual.carry, 4.0), dict.fromkeys(usual.back, 3.5))
    nodes["a2"].capability = Capability("slower", tuple(usual.carry), "friction", None, slow)
    (now,) = both.flows(FlowQuestion(("deburr", "mark"), shared))
    assert now.set_up == shared, "slower is still better than one arm for both"
    stuck = WorkTimes(usual.grip, dict.fromkeys(usual.carry, 40.0), dict.fromkeys(usual.back, 40.0))
    nodes["a2"].capability = Capability("slower", tuple(usual.carry), "friction", None, stuck)
    (now,) = both.flows(FlowQuestion(("deburr", "mark"), shared))
    assert now.set_up == moved


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Has zones tell at once what they let through, the same for every way to share the work out."""
    monkeypatch.setattr(zone, "simulated", lambda line, times: 100.0)
    monkeypatch.setattr(ZoneTwin, "_from", lambda self, now, way, *rest: zone.SetUpFlow(dict(way), 100.0))


def run_of(fault: str, mode: Mode, duration: float) -> LineRun:
    run = LineRun(LINE, LineSettings(duration, mode, (("a2", fault),)))
    run.run()
    return run


def said(run: LineRun) -> list[tuple[str, str]]:
    return [(decision.who, decision.what) for decision in run.course.decisions]


@pytest.mark.usefixtures("_quick")
def test_the_blocks_get_what_the_twin_has_found_and_their_own_back_after_repair(tmp_path: Path) -> None:
    run = run_of("D3*=3@60-110", "act", 112.0)
    assert said(run) == [
        ("monitor of a2", "finding"),
        ("twin of a2", "settings"),
        ("operator", "repair"),
    ]
    ours = run.emulated["a2"]
    kinds = [given.kind for given in ours.inputs if given.kind not in ("bring", "take")]
    assert kinds == ["fault", "settings", "release"]
    assert ours.settings is None
    assert run.work.assignment == LINE.assignment
    assert (run.plant.lost, run.plant.collisions) == (0, 0)
    assert isinstance(ours, EmulatedStation)
    replayed(PLAN, ours.inputs, 11_200).write_log(tmp_path / "alone.parquet")
    ours.write_log(tmp_path / "ours.parquet")
    assert (tmp_path / "alone.parquet").read_bytes() == (tmp_path / "ours.parquet").read_bytes()
    settled = next(given.tick for given in ours.inputs if given.kind == "settings")
    seen = ours.log.since(settled + 800)
    rows = 11_000 - settled - 800
    assert np.abs(seen.stack("target") - seen.stack("measured"))[:rows].max() < 0.01, "it follows its path again"


@pytest.mark.usefixtures("_quick")
def test_twins_that_propose_change_nothing_until_a_person_has_it_done() -> None:
    run = run_of("K3*=0.5@60", "propose", 78.0)
    assert said(run)[:2] == [("monitor of a2", "finding"), ("twin of a2", "proposal")]
    assert said(run).count(("twin of a2", "proposal")) == 1
    assert run.emulated["a2"].settings is None
    run.settle("a2", "ada", "as proposed")
    assert run.emulated["a2"].settings == run.capability("a2").settings
    assert run.course.decisions[-1].who == "ada"
    run.release("a2", "ada", "its motor is new")
    assert run.emulated["a2"].settings is None
    with pytest.raises(DtwinError, match="whose twin has found other settings"):
        run.settle("a2", "ada", "again")
    with pytest.raises(DtwinError, match="works with other settings"):
        run.release("a2", "ada", "again")


class FakeNode:
    """A twin of a station that has just found something."""

    plan, doubt, rests, slowness = PLAN, "", True, None

    def __init__(self, capability: Capability) -> None:
        self.capability = capability

    @property
    def times(self) -> WorkTimes:
        return rehearsed(PLAN)

    def repaired(self) -> None:
        self.doubt = ""

    def stopped(self, why: str, then: Capability | None = None) -> None:
        self.capability = Capability("nothing", (), why) if then is None else then.stopped(why)

    def watch(
        self,
        log: Any,
        arm: int,
        stopped: bool = False,
        settings: Any = None,
        mass: float | None = None,
        needed: Collection[str] = (),
    ) -> Sequence[Finding]:
        return [] if settings or stopped else [found("K1", -0.4)]

    def state_of(self, finding: Any) -> Any:
        return "failed"


def looked(
    able: Capability, needed: set[str], arm: int = FREE, mode: Mode = "act"
) -> tuple[list[str], list[str], Guard]:
    """What a watch has done about an arm that can do so much, the reasons it gives, and the watch."""
    did: list[str] = []
    hands = Hands(
        lambda station, state, why: did.append(f"stop {state}"),
        lambda station, settings, why: did.append(settings.text()),
        lambda station: {(place, 0.21) for place in needed},
        lambda station: None,
        lambda station: 0,
        lambda decision: None,
    )
    guard = Guard({"a2": FakeNode(able)}, mode, hands)
    return did, guard.look("a2", None, arm, 0, 10.0), guard


@cache
def some() -> Capability:
    return Capability("some places", ("blue", "red"), "weak", ArmSettings(2.2, HEALTHY), rehearsed(PLAN))


SOME_TEXT = "a model of what it is now, and 2.2 s for a motion"


def test_an_arm_goes_on_only_if_it_reaches_the_places_where_its_boxes_belong() -> None:
    did, reasons, guard = looked(some(), {"red"})
    assert (did, reasons) == ([SOME_TEXT], ["a2 can do some places"])
    assert guard.capability("a2").places == ("blue", "red")
    did, reasons, guard = looked(some(), {"red", "green"})
    assert (did, reasons) == (["stop failed"], ["a2 can do nothing"])
    assert guard.capability("a2").places == (), "a stopped arm does nothing, whatever it could"
    node = guard._nodes["a2"]
    node.capability = some()
    assert guard.look("a2", None, FREE, 0, 11.0) == [], "what is found of it later changes nothing of that"
    assert guard.capability("a2").places == ()
    did, reasons, _ = looked(replace(some(), ability="all"), {"red"})
    assert (did, reasons) == ([SOME_TEXT], []), "there is no reason to share the work out otherwise"
    assert looked(some(), {"red"}, mode="propose")[0] == []


def nothing(*words: Any) -> None:
    """Has no hand in it."""


@pytest.mark.parametrize("explained", [True, False])
def test_a_stop_that_nothing_explains_is_told_as_such_once(explained: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    notes: list[Decision] = []
    hands = Hands(nothing, nothing, lambda station: (), nothing, lambda station: 0, notes.append)
    guard = Guard({"a2": FakeNode(Capability("all", ("red",), "nothing is wrong"))}, "act", hands)
    for second in range(40):
        late = [found("K1", -0.4)] if explained and second == 5 else []
        monkeypatch.setattr(FakeNode, "watch", lambda self, *words, late=late: late)
        guard.look("a2", None, HOLDING, 1, 10.0 + second)
    whats = [(note.time, note.what) for note in notes]
    if explained:
        assert whats == [(10.0, "stop"), (15.0, "finding")]
    else:
        assert whats == [(10.0, "stop"), (26.0, "no finding")]
        assert "released" in notes[-1].why


def test_what_is_found_again_and_again_is_told_once_until_the_arm_is_repaired() -> None:
    notes: list[Decision] = []
    hands = Hands(nothing, nothing, lambda station: (), nothing, lambda station: 0, notes.append)
    guard = Guard({"a2": FakeNode(some())}, "propose", hands)
    for second in range(5):
        guard.look("a2", None, HOLDING, 0, 10.0 + second)
    assert [note.what for note in notes] == ["finding", "proposal"]
    guard.repaired("a2", 20.0, "ada", "mended")
    guard.look("a2", None, HOLDING, 0, 21.0)
    assert [note.what for note in notes] == ["finding", "proposal", "repair", "finding", "proposal"]


def test_an_arm_gets_other_settings_between_two_boxes() -> None:
    did, _, guard = looked(some(), {"red"}, HOLDING)
    assert did == []
    node = guard._nodes["a2"]
    node.rests = False
    guard.look("a2", None, FREE, 0, 11.0)
    assert did == []
    node.rests = True
    guard.look("a2", None, FREE, 0, 12.0)
    assert did == [SOME_TEXT]


def test_an_arm_that_new_settings_make_worse_is_stopped() -> None:
    did, _, guard = looked(some(), {"red"})
    node = guard._nodes["a2"]
    assert isinstance(node, FakeNode)
    node.doubt = "with the settings on trial it was 200 mrad from its path"
    assert guard.look("a2", None, FREE, 0, 40.0, some().settings) == ["a2 can do nothing"]
    assert did == [SOME_TEXT, "stop failed"]
    assert "200 mrad" in guard.capability("a2").why


def test_an_arm_that_becomes_slower_is_told_once_though_nothing_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    notes: list[Decision] = []
    hands = Hands(nothing, nothing, lambda station: (), nothing, lambda station: 0, notes.append)
    node = FakeNode(Capability("all", ("blue", "red"), "nothing is wrong"))
    guard = Guard({"a2": node}, "act", hands)
    monkeypatch.setattr(FakeNode, "watch", lambda self, *words: [])
    told, abilities = [], []
    for second, slowness in enumerate((None, 1.0, 1.05, 1.3, 1.32, 1.35, 1.0)):
        monkeypatch.setattr(FakeNode, "slowness", slowness)
        told.append(guard.look("a2", None, HOLDING, 0, 10.0 + second))
        abilities.append(node.capability.ability)
    assert [bool(reasons) for reasons in told] == [False, False, False, True, False, False, True]
    assert abilities == ["all", "all", "all", "slower", "slower", "slower", "all"]
    assert node.capability.places == ("blue", "red")
    for second, slowness in enumerate((1.3, None, 1.05, 1.0)):  # settings that are changed, or a repair
        monkeypatch.setattr(FakeNode, "slowness", slowness)
        assert bool(guard.look("a2", None, HOLDING, 0, 20.0 + second)) == (slowness == 1.3)
    del notes[2:]
    assert told[3] == ["a2 takes 1.30 times as long to bring a box as at first"]
    assert [(note.time, note.what, note.who) for note in notes] == [
        (13.0, "finding", "twin of a2"),
        (16.0, "finding", "twin of a2"),
    ]


def test_a_trial_compares_an_arm_with_what_it_was_before() -> None:
    station, node = EmulatedStation(PLAN), twin()
    wrong = ArmSettings(1.2, HEALTHY.with_values({"D2": 0.3, "D3": 0.3}))
    station.advance(1000)
    node.watch(station.log, FREE, settings=station.settings)
    assert node.doubt == ""
    station.give("settings", text=settings_text(wrong))
    station.advance(1000)
    node.watch(station.log, FREE, settings=station.settings)
    station.give("bring", 0.2, "red")
    for _ in range(6):
        report = station.advance(100)
        node.watch(station.log, report.arm, settings=station.settings)
    assert "mrad from its path" in node.doubt
    node.repaired()
    assert node.doubt == ""


def test_settings_out_of_range_reach_no_station() -> None:
    station = EmulatedStation(PLAN)
    for wrong in (ArmSettings(0.0, HEALTHY), ArmSettings(2.0, HEALTHY.with_values({"D1": 50.0}))):
        with pytest.raises(DtwinError, match=r"target time: expected|D1: expected 0 to 5"):
            station.apply(Input(0, "settings", text=settings_text(wrong)))
    assert station.settings is None


def test_the_best_knows_how_fast_a_changed_arm_could_be() -> None:
    usual = rehearsed(PLAN)
    loads = {(place, 0.21): 0.2 for place in usual.carry}
    choices = slowed(PLAN, "D2*=6", loads)
    assert set(choices[0]) < set(loads), "at the usual target time it does not reach all places"
    full = next(rounds for rounds in choices if set(rounds) == set(loads))
    assert full["red", 0.21].carry > usual.carry["red"]
