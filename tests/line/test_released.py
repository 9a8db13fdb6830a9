"""Arms of a line that are stopped, and released by a person with the settings that their twins have found."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import pytest

from dtwin.bus.line.plant import ArmSettings, Settings
from dtwin.line.file import line_of
from dtwin.line.line import Load
from dtwin.line.run import LineRun, LineSettings
from dtwin.line.station import FREE, HOLDING, WorkTimes
from dtwin.line.twins import zone
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.decisions import Decision
from dtwin.line.twins.guard import Guard, Hands
from dtwin.line.twins.zone import ZoneTwin
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.monitoring.verdict import Finding, finding
from dtwin.parameters import ArmParameters

LINE = line_of("default")
USUAL = WorkTimes(0.5, {"red": 3.0}, {"red": 2.0})
SLOWER = Capability("slower", ("blue", "red", "green"), "weak", ArmSettings(2.5, ArmParameters()), USUAL)
LIGHT = replace(SLOWER, ability="lighter boxes", places=(), lighter=(("red", 0.1),))
WEAK = finding(parse_fault_id("K1"), 1.0, 1.5, -0.4)


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Has zones tell at once what they let through, the same for every way to share the work out."""
    monkeypatch.setattr(zone, "simulated", lambda line, times: 100.0)
    monkeypatch.setattr(ZoneTwin, "_from", lambda self, now, way, *rest: zone.SetUpFlow(dict(way), 100.0))


@pytest.mark.usefixtures("_quick")
def test_an_arm_that_the_blocks_stop_goes_on_once_a_person_agrees_with_its_twin() -> None:
    run = LineRun(LINE, LineSettings(110.0, "act", (("a2", "K3*=0.5@74"),)))
    while run.time < 80.0:
        run.step()
    told = [(decision.who, decision.what) for decision in run.course.decisions]
    assert told == [
        ("monitor of a2", "finding"),
        ("blocks of a2", "stop"),
        ("twin of a2", "proposal"),
        ("overall twin", "set-up"),
    ]
    able = run.capability("a2")
    assert (able.ability, able.places) == ("nothing", ())
    assert able.once_released is not None
    assert able.once_released.ability == "all"
    assert run.is_stopped("a2"), "no twin releases an arm"
    assert run.emulated["a2"].settings is None
    run.settle("a2", "ada", "as proposed")
    while not run.over:
        run.step()
    assert not run.is_stopped("a2")
    assert run.emulated["a2"].settings == able.once_released.settings
    assert (run.capability("a2").ability, run.capability("a2").once_released) == ("all", None)
    brought = [event.time for event in run.course.events if event.who == "a2" and event.kind == "done"]
    assert 80.0 < brought[-1] < 85.0, "it has brought the box that it held"
    assert (run.plant.lost, run.plant.unfinished) == (0, 0)
    assert [(each.who, each.what) for each in run.course.decisions[4:]] == [("ada", "settings")]


class ScriptedNode:
    """A twin of a station that finds what a test says, and takes up settings as the twins do."""

    plan, doubt, rests, slowness, times = LINE.stations[1], "", True, None, USUAL

    def __init__(self) -> None:
        self.capability = Capability("all", ("red",), "nothing is wrong")
        self.finds: Capability | None = None

    def repaired(self) -> None:
        raise AssertionError("nobody has repaired it")

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
        then = self.capability.once_released
        if then is not None and settings == then.settings:
            self.capability = then
        if self.finds is None:
            return []
        self.capability, self.finds = self.finds, None
        return [WEAK]

    def state_of(self, finding: Any) -> Any:
        return "failed"


class Watch:
    """A watch of station a2, what it says to others, and what it writes down."""

    def __init__(self, load: Load | None = None) -> None:
        self.said: list[str] = []
        self.noted: list[Decision] = []
        self.node, self.time = ScriptedNode(), 10.0
        hands = Hands(
            lambda station, state, why: self.said.append("stop"),
            lambda station, settings, why: self.said.append("settings"),
            lambda station: {("red", 0.2)},
            lambda station: load,
            lambda station: 0,
            self.noted.append,
        )
        self.guard = Guard({"a2": self.node}, "act", hands)

    def look(
        self, stop: int, finds: Capability | None = None, settings: Settings | None = None, arm: int = HOLDING
    ) -> list[str]:
        self.time += 1.0
        self.node.finds = finds
        return self.guard.look("a2", None, arm, stop, self.time, settings)

    def once_released(self) -> str | None:
        then = self.guard.capability("a2").once_released
        return None if then is None else then.ability

    def proposals(self) -> int:
        return [decision.what for decision in self.noted].count("proposal")


def found_after_a_stop(finds: Capability = SLOWER, load: Load | None = None, arm: int = HOLDING) -> Watch:
    watch = Watch(load)
    watch.look(2, arm=arm)
    watch.look(2, finds, arm=arm)
    return watch


def test_what_is_found_of_a_stopped_arm_is_proposed_once_and_nothing_is_done() -> None:
    watch = found_after_a_stop()
    assert (watch.said, watch.once_released(), watch.proposals()) == ([], "slower", 1)
    watch.look(2, SLOWER)
    assert watch.proposals() == 1
    watch.look(2, replace(SLOWER, settings=ArmSettings(3.0, ArmParameters())))
    assert watch.proposals() == 2
    watch.look(2, Capability("nothing", (), "its encoder has stopped"))
    assert (watch.said, watch.once_released(), watch.proposals()) == ([], None, 2)


def test_settings_that_were_found_as_the_blocks_stopped_the_arm_are_proposed() -> None:
    watch = Watch()
    watch.look(0, SLOWER)
    assert watch.look(2) == ["a2 can do nothing"]
    assert watch.once_released() == "slower"
    watch.time += 60.0
    watch.look(2)
    assert "no finding" not in [decision.what for decision in watch.noted]


def test_released_with_them_it_has_its_work_back_and_with_others_it_has_not() -> None:
    watch = found_after_a_stop()
    assert watch.look(0, settings=ArmSettings(9.0, ArmParameters())) == []
    assert "a2" in watch.guard.stopped
    assert watch.look(0, settings=SLOWER.settings) == ["a2 can do slower"]
    assert (watch.guard.stopped, watch.guard.capability("a2")) == (set(), SLOWER)
    assert watch.look(2, settings=SLOWER.settings) == ["a2 can do nothing"], "it is watched again"
    assert watch.once_released() is None, "with settings that are in force it was stopped"


@pytest.mark.parametrize(
    ("finds", "load", "arm", "proposed"),
    [
        (LIGHT, ("red", 0.1), HOLDING, "lighter boxes"),
        (LIGHT, ("red", 0.2), HOLDING, None),
        (LIGHT, None, HOLDING, None),
        (LIGHT, None, FREE, "lighter boxes"),
        (replace(SLOWER, settings=None), None, FREE, None),
    ],
)
def test_an_arm_is_to_be_released_only_if_it_brings_the_box_that_it_has(
    finds: Capability, load: Load | None, arm: int, proposed: str | None
) -> None:
    assert found_after_a_stop(finds, load, arm).once_released() == proposed


def test_what_a_twin_tells_of_an_arm_is_what_the_twin_of_the_line_hears() -> None:
    stopped = SLOWER.stopped("weak")
    for able in (replace(SLOWER, times=None), replace(LIGHT, times=None), stopped):
        heard = Capability.heard(able.told("a2"))
        assert (heard.ability, heard.places, heard.why, heard.settings) == (
            *(able.ability, able.places, able.why, able.settings),
        )
        assert heard.lighter == able.lighter
    then = Capability.heard(stopped.told("a2")).once_released
    assert then is not None
    assert (then.ability, then.settings, then.why) == ("slower", SLOWER.settings, "weak")


def test_an_arm_that_a_person_stops_is_not_to_be_released_by_what_a_twin_says() -> None:
    watch = found_after_a_stop()
    watch.guard.by_hand("a2", "ada", "it smokes", 20.0)
    assert (watch.said, watch.once_released()) == ([], None)
    elsewhere = found_after_a_stop()
    assert elsewhere.guard.known("a2", "it was stopped by ada: it smokes") == []
    assert elsewhere.once_released() is None
    own = Watch()
    own.look(0, replace(SLOWER, ability="some places", places=("blue",)), arm=FREE)
    assert own.said == ["stop"], "it does not bring what it is needed for"
    assert own.once_released() == "some places"
    why = next(decision.why for decision in own.noted if decision.what == "stop")
    assert own.guard.known("a2", why) == []
    assert own.once_released() == "some places", "the plant says what its own twin has said"
