"""The console of a line without a browser: what it is told, desks of zones, commands, alarms, and a lost line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from dtwin.bus.line.messages import SetUpRequest, StationWord, ZoneDeskRequest
from dtwin.bus.line.plant import PlantState, PlantWord, StationReading
from dtwin.bus.line.topics import PLANT_STATE
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.console.line.conditions import conditions
from dtwin.console.line.faces import LineFace
from dtwin.console.people.desk import TIME_OUT, ZoneDeskBook
from dtwin.console.people.users import Users
from dtwin.console.telling import Health
from dtwin.errors import ParameterError
from dtwin.line.file import line_of
from tests.support.console import Visitor
from tests.support.made_up_line import FakeLine, ServedLine, serve_line, state_now
from tests.support.waiting import until


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedLine]:
    with serve_line(tmp_path) as found:
        found.until_told()
        yield found


def take(visitor: Visitor, zone: str) -> tuple[int, str]:
    status, answer = visitor.post(f"/api/desk/occupy?zone={zone}")
    return status, answer["text"]


def command(visitor: Visitor, name: str, **form: object) -> tuple[int, str]:
    status, answer = visitor.post(f"/api/command/{name}", form)
    return status, answer["text"]


def told(served: ServedLine) -> LineFace:
    """What pages are told of the line."""
    line = served.console.hub.state().line
    assert line is not None
    return line


def angles(served: ServedLine) -> tuple[float, ...] | None:
    """What pages are told of the joints of station a2."""
    station = served.console.hub.station("a2")
    assert station is not None
    return station.frame.theta


def test_a_page_is_told_how_the_line_does_and_how_it_was_built(served: ServedLine) -> None:
    state = served.console.hub.state()
    assert state.line is not None
    assert state.line.plan is not None
    assert state.conditions == ()
    assert "19 boxes left, 6 inside, 148 boxes/h" in state.doing
    line = line_of("default")
    built = {zone.name: zone for zone in state.line.plan.zones}
    assert set(built) == {zone.name for zone in line.zones}
    for zone in line.zones:
        assert built[zone.name].nodes == dict(zone.track.nodes)
        assert built[zone.name].segments == tuple((each.start, each.end) for each in zone.track.segments)
    until(lambda: told(served).expected, "the twins tell what they expect")
    expected = told(served).expected
    assert expected is not None
    assert expected.rate_now == 150.0


def test_each_zone_has_a_desk_of_its_own(served: ServedLine) -> None:
    anna, carol = served.visitor(), served.visitor()
    assert take(anna, "a") == (200, "you have the desk of a")
    assert take(carol, "a")[0] == 409
    assert take(carol, "b")[0] == 200
    served.line.fail("a2", "K2 is weak")
    served.line.fail("b1", "K2 is weak")
    served.until_told()
    assert command(carol, "release", station="a2") == (409, "somebody has the desk of zone a")
    assert command(anna, "release", station="b1") == (409, "somebody has the desk of zone b")
    assert command(anna, "release", station="a2", why="repaired") == (200, "done")
    assert served.line.asked == [StationWord("somebody", "repaired", "a2")]
    assert carol.post("/api/desk/leave?zone=b")[0] == 200
    assert command(carol, "release", station="b1") == (409, "take the desk of zone b first")
    assert carol.post("/api/desk/leave?zone=a")[0] == 200
    assert served.line.desks.state().desks[0].user == "somebody"  # who does not have a desk frees none


def test_a_set_up_across_zones_needs_the_desks_of_all_that_it_concerns(served: ServedLine) -> None:
    anna = served.visitor()
    within, across = {"mark": "a1"}, {"mark": "b1"}
    assert command(anna, "setup", based_on=0, set_up=within)[1] == "take the desk of zone a first"
    take(anna, "a")
    assert command(anna, "setup", based_on=0, set_up=across) == (409, "take the desk of zone b first")
    status, text = command(anna, "setup", based_on=0, set_up=within, why="a2 is looked at")
    assert (status, text) == (200, "set-up 1 in force since 600.0 s, 100.0 boxes/h expected")
    served.until_told()
    take(anna, "b")
    assert command(anna, "setup", based_on=1, set_up=across)[0] == 200
    assert served.line.asked == [
        SetUpRequest("somebody", "a2 is looked at", 0, within),
        SetUpRequest("somebody", "from the console", 1, across),
    ]
    assert "expected deburr, mark, test or pack" in command(anna, "setup", based_on=2, set_up={"paint": "a1"})[1]
    assert "expected a1, a2, b1 or b2" in command(anna, "setup", based_on=2, set_up={"mark": "c1"})[1]


def test_a_stop_and_a_question_need_no_desk(served: ServedLine) -> None:
    anna, carol = served.visitor(), served.visitor()
    take(carol, "a")
    status, answer = anna.post("/api/command/predict", {"set_up": {"mark": "a1"}})
    assert (status, answer["reply"]["rate"], answer["reply"]["rate_now"]) == (200, 100.0, 150.0)
    assert served.line.asked == []
    assert command(anna, "stop", station="a2", why="smoke") == (200, "done")
    assert served.line.asked == [StationWord("somebody", "smoke", "a2")]


def test_a_proposal_is_approved_from_the_desks_of_its_zones(served: ServedLine) -> None:
    anna = served.visitor()
    take(anna, "b")
    proposal = served.line.propose({"mark": "a1"}, "a2 can do nothing")
    served.until_told()
    state = served.console.hub.state()
    assert [each.text for each in state.conditions] == ["a proposal waits for a person: look at Line"]
    shown = {"number": proposal.number, "digest": proposal.digest}
    assert command(anna, "approve", **shown) == (409, "take the desk of zone a first")
    assert served.line.state.version == 0
    take(anna, "a")
    status, text = command(anna, "approve", **shown)
    assert status == 200
    assert text.startswith("proposal 1 is approved; version 1 of the set-up in force")
    assert served.line.state.set_up["mark"] == "a1"
    served.until_told()
    assert command(anna, "decline", **shown)[1] == "no proposal waits"


def test_two_consoles_agree_who_has_the_desks(served: ServedLine, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    with serve_line(tmp_path / "other", line=served.line) as other:
        other.until_told()
        anna, carol = served.visitor(), other.visitor()
        assert take(anna, "a")[0] == 200
        assert take(carol, "a") == (409, "somebody has the desk of zone a")
        served.line.fail("a1", "smoke")
        other.until_told()
        assert command(carol, "release", station="a1")[0] == 409
        served.clock.ahead += TIME_OUT + 1.0  # nobody gives a sign of life of its page
        assert take(carol, "a")[0] == 200


def test_all_desks_are_taken_and_left_at_once(served: ServedLine) -> None:
    anna = served.visitor()
    assert anna.post("/api/desk/occupy")[1]["text"] == "you have the desk of a, b"
    assert [desk.user for desk in served.line.desks.state().desks] == ["somebody", "somebody"]
    anna.post("/api/logout")
    assert [desk.user for desk in served.line.desks.state().desks] == ["", ""]


def test_a_zone_that_is_not_there_is_refused_with_those_that_are(served: ServedLine) -> None:
    status, text = take(served.visitor(), "c")
    assert (status, text) == (400, "zone: expected a or b, got 'c'")


def test_a_line_that_does_not_answer_is_lost(served: ServedLine) -> None:
    anna = served.visitor()
    take(anna, "a")
    served.clock.stop()
    served.console.hub.close()
    served.clock.ahead += 2.5
    state = served.console.hub.state()
    assert state.line is not None
    assert state.line.lost.startswith("the line does not answer")
    assert [each.severe for each in state.conditions] == [True]
    assert command(anna, "setup", based_on=0, set_up={"mark": "a1"}) == (409, "the values are older than 2 s")
    assert command(anna, "stop", station="a1")[0] == 200  # a stop is always tried


def test_a_line_that_has_gone_is_told_and_its_alarm_stands(tmp_path: Path) -> None:
    with serve_line(tmp_path) as served:
        served.until_told()
        served.line.bus.close()
        until(lambda: "has ended" in told(served).lost, "it is told")
        console = served.console
        console.annunciator.look(console.hub.state(), [], console.hub.age, 5.0)
        (alarm,) = console.annunciator.alarms.alarms()
        assert (alarm.name, alarm.priority) == ("line/stale", "high")
        status, text = command(served.visitor(), "stop", station="a1")
        assert status == 409
        assert text


def test_an_arm_is_stopped_by_the_plant_where_the_twin_of_the_line_has_gone(tmp_path: Path) -> None:
    line = FakeLine(twin=False)
    with serve_line(tmp_path, line=line) as served:
        until(lambda: "its plant goes on" in told(served).lost, "it is told")
        status, text = command(served.visitor(), "stop", station="a2", why="smoke")
        assert status == 200
        assert text == "the plant has stopped it, because the twin of the line does not answer"
        assert line.asked == [PlantWord("a2", "failed", "somebody: smoke")]
    line.bus.close()


def test_alarms_come_and_go_and_are_acknowledged_from_the_desk_of_their_zone(served: ServedLine) -> None:
    anna, console = served.visitor(), served.console
    take(anna, "b")
    served.line.fail("a2", "K2 is weak")
    served.until_told()
    until(lambda: console.annunciator.alarms.alarms(), "the alarm is raised")
    (alarm,) = console.annunciator.alarms.alarms()
    assert (alarm.name, alarm.text) == ("line/station a2", "a2: the arm is stopped")
    status, answer = anna.post("/api/alarm/acknowledge", {"name": alarm.name})
    assert (status, answer["text"]) == (409, "take the desk of zone a first")
    take(anna, "a")
    assert anna.post("/api/alarm/acknowledge", {"name": alarm.name})[0] == 200
    command(anna, "release", station="a2")
    until(lambda: not console.annunciator.alarms.alarms(), "the alarm is over")


def test_the_arm_of_a_station_is_heard_while_somebody_looks_at_it(served: ServedLine) -> None:
    hub = served.console.hub
    hub.watch(frozenset({"", "a2", "nobody"}))
    assert hub.station("nobody") is None
    assert angles(served) is None

    def heard() -> bool:
        served.line.sample("a2", 12)
        return angles(served) == (0.1, 0.2, 0.3)

    until(heard, "its readings arrive")
    assert hub.station("a1") is None
    hub.watch(frozenset())
    assert hub.station("a2") is None


def test_viewers_take_no_desk_and_command_nothing(tmp_path: Path) -> None:
    users = Users(tmp_path / "users.json")
    users.set("vera", "viewer", "a long password")
    with serve_line(tmp_path, users) as served:
        served.until_told()
        vera = Visitor(served.web.address)
        assert vera.login("vera", "a long password") == 200
        assert take(vera, "a") == (409, "needs the role operator, vera is viewer")
        assert command(vera, "stop", station="a1")[0] == 409
        assert served.line.asked == []


def test_everything_is_in_the_audit_file(served: ServedLine) -> None:
    anna = served.visitor()
    take(anna, "a")
    command(anna, "setup", based_on=0, set_up={"mark": "a1"})
    names = [json.loads(line)["command"] for line in served.audit.read_text().splitlines()]
    assert names == ["desk of a, occupy", "setup, given", "setup"]


def test_desks_know_their_zones_and_do_all_or_nothing() -> None:
    book = ZoneDeskBook(("a", "b"), lambda: 0.0)
    with pytest.raises(ParameterError, match="zone: expected a or b, got 'c'"):
        book.ask(ZoneDeskRequest("s", "anna", "occupy", ("a", "c")))
    assert [desk.session for desk in book.state().desks] == ["", ""]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"lost": 1}, "boxes lost: 1"),
        ({"collisions": 2}, "vehicles have touched: 2"),
        ({"outside": 3}, "3 boxes wait in front of the source"),
    ],
)
def test_what_is_abnormal_is_told(changed: dict[str, int], words: str) -> None:
    state = msgspec.structs.replace(state_now(), **changed)
    assert [each.text for each in conditions(state, {}, "", 0)] == [words]
    assert conditions(state_now(), {"zone-a": Health("running"), "console": Health("gone")}, "", 0) == ()


def test_a_process_of_the_line_that_has_died_is_told() -> None:
    (found,) = conditions(state_now(), {"zone-a": Health("dead", "killed by signal 9")}, "", 0)
    assert (found.text, found.severe) == ("zone-a is dead: killed by signal 9", True)


@pytest.mark.parametrize("killed", [True, False])
def test_while_the_twin_of_the_line_is_dead_or_frozen_the_plant_is_shown(tmp_path: Path, killed: bool) -> None:
    with serve_line(tmp_path) as served:
        served.until_told()
        line, hub = served.line, served.console.hub
        known = line.state

        def told() -> LineFace:
            face = hub.state().line
            assert face is not None
            return face

        if killed:
            line.bus.close()
            until(lambda: not hub._is_there(), "the twin has gone")
        else:
            hub.close()
        served.clock.ahead += 2.5
        assert told().lost
        readings = tuple(
            StationReading(each.name, 0, int(each.name == "a2"), "it smokes" if each.name == "a2" else "")
            for each in known.stations
        )
        seen = PlantState(640.0, 3, known.set_up, 30, 5, 25, 0, 0, 150.0, readings, known.vehicles, zones=known.zones)
        with Bus(open_peer(line.meet), "line", "line") as plant:
            tell = plant.publisher(PLANT_STATE)

            def shown() -> bool:
                tell(seen)
                now = told().state
                return now is not None and now.time == 640.0

            until(shown, "what the plant tells is shown")
            face = told()
            assert face.state is not None
            assert (face.state.left, face.state.version) == (25, 3)
            a1, a2 = face.state.stations[:2]
            assert (a1.doing, a1.ability, a2.doing, a2.why) == ("waits", "all", "stopped", "it smokes")
            assert "silent since 600.0 s" in face.lost
            assert hub.frame().time == 640.0
            assert [(each.key, each.severe) for each in hub.state().conditions] == [
                ("twin", True),
                ("station a2", True),
            ]
            assert command(served.visitor(), "setup", based_on=0, set_up={"mark": "a1"})[0] == 409
        served.clock.ahead += 2.5
        assert "silent since" not in told().lost, "the plant is silent, too"
        assert "stale" in {each.key for each in hub.state().conditions}


def test_a_console_that_begins_after_the_twin_of_the_line_has_ended_shows_what_the_plant_tells(
    tmp_path: Path,
) -> None:
    known, made = state_now(), FakeLine()
    made.bus.close()
    readings = tuple(
        StationReading(each.name, 1, int(each.name == "a2"), zone=each.zone, worked=4) for each in known.stations
    )
    seen = PlantState(640.0, 3, known.set_up, 30, 5, 25, 0, 0, 150.0, readings, known.vehicles, zones=known.zones)
    with serve_line(tmp_path, line=made) as served, Bus(open_peer(made.meet), "line", "line") as plant:
        hub, tell = served.console.hub, plant.publisher(PLANT_STATE)

        def shown() -> LineFace | None:
            tell(seen)
            face = hub.state().line
            return face if face is not None and face.state is not None else None

        served.clock.ahead += 2.5
        face = until(shown, "what the plant tells is shown")
        assert face.state is not None
        assert (face.state.name, face.state.left, face.state.version) == ("line", 25, 3)
        a1, a2 = face.state.stations[:2]
        assert (a1.zone, a1.doing, a1.ability, a1.worked) == ("a", "works", "not known", 4)
        assert a2.doing == "stopped"
        assert face.zone_of("a2") == "a"
        assert "silent since before this console began" in face.lost
        assert [(each.key, each.severe) for each in hub.state().conditions] == [("twin", True), ("station a2", True)]
        assert hub.state().doing == "stopped: a2"
        assert hub.frame().time == 640.0
