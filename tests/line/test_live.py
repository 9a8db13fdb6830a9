"""A line in parts that know each other over the bus alone: its plant, its zone's twin, and the twin of the line."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import pytest

from dtwin.bus.line.messages import LineState, SetUpDone, SetUpRequest, StationWord
from dtwin.bus.line.plant import ArmSettings, PlantState, PlantWord, Settings
from dtwin.bus.line.topics import LINE_RELEASE, LINE_SETTLE, LINE_STATE, LINE_STOP, PLANT_SET_UP, PLANT_WORD, SET_UP
from dtwin.bus.messages import FAULT, PATH, SENSORS, Done, FaultRequest
from dtwin.bus.messages import Path as PathAngles
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError
from dtwin.line.file import line_of
from dtwin.line.floor import Floor
from dtwin.line.line import Line
from dtwin.line.live import overall
from dtwin.line.live.overall import LiveOverall
from dtwin.line.live.plant import LivePlant
from dtwin.line.live.zone import OVERALL, LiveZone
from dtwin.line.records.keeper import Keeper
from dtwin.line.records.kept import COURSE, prepare, read
from dtwin.line.records.tables import ask
from dtwin.line.station import WorkTimes, believed_settings
from dtwin.line.twins import node, zone
from dtwin.line.twins.decisions import Decision, Mode
from dtwin.line_file import LineFile
from dtwin.monitoring.estimation.belief import assumed
from dtwin.monitoring.readiness.rehearsal import Rehearsal
from dtwin.monitoring.settings import MonitorSettings
from dtwin.parameters import ROOT, ArmParameters
from dtwin.signals import Sensors
from dtwin.simulation.proposals.book import Book
from tests.support.ports import free_port
from tests.support.waiting import until

KEY = bytes(range(32))
TIMES = dict.fromkeys(("blue", "red", "green"), 2.5)


def flow(line: Line, times: object) -> float:
    """Boxes an hour as if a box took a minute at a station for each operation, in the place of a long simulation."""
    stations = list(line.assignment.values())
    return 60.0 / max(stations.count(name) for name in stations)


@pytest.fixture(scope="module", autouse=True)
def _made() -> None:
    """Machine code that is made only once would stop all parts here, which share a process, for longer than they wait
    for one another."""
    line = line_of("default")
    Floor(line).step()
    believed = believed_settings(line.stations[0])
    for _, part in Rehearsal(assumed(believed.arm, (1e-3,) * 3), MonitorSettings()).parts():
        part()


@pytest.fixture(scope="module", autouse=True)
def _quick(_made: None) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(zone, "simulated", flow)
        patch.setattr(node, "rehearsed", lambda plan, usual: WorkTimes(0.5, TIMES, TIMES))
        yield


class Parts:
    """The parts of a line of one zone, each on a thread and a session of its own; the plant goes fast."""

    def __init__(self, folder: Path) -> None:
        (text,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "line.md").read_text(), re.DOTALL)
        file = folder / "small.toml"
        file.write_text(text.replace('machine = "coulomb"', ""))
        self.line, self.history = line_of(str(file)), folder / "history.jsonl"
        self.book = folder / "proposals.jsonl"
        self.meet = f"tcp/127.0.0.1:{free_port()}"
        self.bus = self.session()

    def session(self) -> Bus:
        return Bus(open_peer(self.meet), "line", "line", KEY)

    def state(self) -> LineState:
        return self.bus.ask(LINE_STATE, None, LineState)

    def plant(self) -> PlantState:
        return self.bus.ask(PLANT_SET_UP, None, PlantState)

    def decisions(self) -> list[Decision]:
        return list(LineFile(self.history, Decision, "a decision of the line").entries())

    @contextmanager
    def working(self, work: Callable[[], Any], bus: Bus) -> Iterator[None]:
        """Lets a part work on a thread, and closes its session at the end."""
        over = threading.Event()

        def loop() -> None:
            while not over.is_set():
                work()

        thread = threading.Thread(target=loop)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
            bus.close()

    @contextmanager
    def with_plant(self) -> Iterator[None]:
        bus = self.session()
        plant = LivePlant(Floor(self.line), (), bus, time.monotonic)

        def work() -> None:
            plant.step()
            plant.serve(0.005)

        with self.working(work, bus):
            yield

    @contextmanager
    def with_zone(self, mode: Mode = "act") -> Iterator[None]:
        bus, came = self.session(), SimpleQueue[Any]()
        twin = LiveZone(self.line, 0, mode, bus, came.put)

        def work() -> None:
            try:
                twin.take(came.get(timeout=0.05))
            except Empty:
                return

        with self.working(work, bus):
            yield

    @contextmanager
    def with_overall(self, again: bool = False) -> Iterator[None]:
        bus = self.session()
        history = LineFile(self.history, Decision, "a decision of the line")
        twin = LiveOverall(self.line, "act", bus, Book(self.book), history, time.monotonic)
        if again:
            twin.resume()
        bus.announce(OVERALL)
        with self.working(twin.look, bus):
            until(lambda: twin.present, "the plant and the zone are heard")
            yield


@pytest.fixture
def parts(tmp_path: Path) -> Iterator[Parts]:
    found = Parts(tmp_path)
    with found.with_plant():
        yield found
    found.bus.close()


def test_work_moves_away_from_an_arm_that_is_stopped_and_comes_back(parts: Parts) -> None:
    with parts.with_zone(), parts.with_overall():
        assert parts.state().set_up == {"glue": "left", "press": "right"}
        parts.bus.ask(LINE_STOP, StationWord("ada", "it smokes", "right"), LineState)
        until(lambda: parts.plant().set_up["press"] == "left", "the work moves")
        until(lambda: parts.state().version == 1, "the twin of the line knows that the plant has taken it")
        right = next(station for station in parts.state().stations if station.name == "right")
        assert (right.doing, right.ability) == ("stopped", "nothing")
        assert right.why == "it was stopped by ada: it smokes"
        asked = SetUpRequest("bob", "to try", parts.state().version, {"press": "right"})
        with pytest.raises(CommunicationError, match="right can do nothing there now: it was stopped by ada"):
            parts.bus.ask(SET_UP, asked, SetUpDone)
        parts.bus.ask(LINE_RELEASE, StationWord("ada", "it is mended", "right"), LineState)
        until(lambda: parts.plant().set_up["press"] == "right", "the work comes back")
        until(lambda: parts.state().version == 2, "the twin of the line knows that the plant has taken it")
        assert parts.plant().version == 2
    said = [(decision.who, decision.what) for decision in parts.decisions()]
    assert said.index(("ada", "stop")) < said.index(("overall twin", "set-up"))
    assert said.count(("overall twin", "set-up")) == 2
    assert [who for who, what in said if what == "repair"] == ["ada"], "what a person did is noted once"


def test_a_fault_is_found_from_what_the_arm_publishes(parts: Parts) -> None:
    with parts.with_zone(), parts.with_overall():
        parts.bus.beside("left").ask(FAULT, FaultRequest(("K2*=0.1@70",)), Done)
        until(lambda: parts.plant().set_up["glue"] == "right", "the work moves")
        until(lambda: any(decision.what == "finding" for decision in parts.decisions()), "it is known why")
    finding = next(decision for decision in parts.decisions() if decision.what == "finding")
    assert (finding.who, finding.station) == ("monitor of left", "left")
    assert finding.why.startswith("voltage constant of joint 2, -90")


def test_an_arm_that_can_work_on_gets_other_settings_until_it_is_released(parts: Parts) -> None:
    def settings() -> Settings | None:
        return next(station for station in parts.plant().stations if station.name == "left").settings

    # Little less than it has: an arm that leaves its path with settings on trial would be stopped.
    weak = ArmParameters().with_values({"K3": 0.98 * ArmParameters().get("K3")})
    with parts.with_zone(), parts.with_overall():
        with pytest.raises(CommunicationError, match="whose twin has found other settings: nothing is wrong"):
            parts.bus.ask(LINE_SETTLE, StationWord("ada", "to try", "left"), LineState)
        found = ArmSettings(2.0, weak)
        parts.bus.ask(PLANT_WORD, PlantWord("left", "settings", "its motor is weak", found), PlantState)
        assert settings() == found
        known = "other settings are in force"
        until(
            lambda: parts.state().stations[0].why.startswith(known), "the twin of the zone learns it from the plant"
        )
        told = parts.bus.ask(LINE_SETTLE, StationWord("ada", "as found", "left"), LineState)
        assert [station.settings for station in told.stations] == [found.text(), ""]
        assert settings() == found
        parts.bus.ask(LINE_RELEASE, StationWord("ada", "its motor is new", "left"), LineState)
        assert settings() is None
        until(lambda: parts.state().stations[0].why == "nothing is wrong", "it is believed to be repaired")
        with pytest.raises(CommunicationError, match="expected one whose arm is stopped, or works with other"):
            parts.bus.ask(LINE_RELEASE, StationWord("ada", "again", "left"), LineState)
        beyond = PlantWord("left", "settings", "slower", ArmSettings(100.0, weak))
        with pytest.raises(CommunicationError, match=r"target time: expected 0\.1 to 60 s"):
            parts.bus.ask(PLANT_WORD, beyond, PlantState)
    assert parts.plant().set_up == {"glue": "left", "press": "right"}
    assert [(each.who, each.what) for each in parts.decisions()] == [("ada", "settings"), ("ada", "repair")]


def test_a_zone_goes_on_by_itself_and_agrees_with_the_twin_of_the_line_afterwards(parts: Parts) -> None:
    with parts.with_zone():
        parts.bus.ask(PLANT_WORD, PlantWord("right", "failed", "it smokes"), PlantState)
        until(lambda: parts.plant().set_up["press"] == "left", "the zone acts alone")
        assert parts.plant().version == 1
        with parts.with_overall():
            until(lambda: parts.state().version == 1, "the twin of the line sees the set-up")
            assert parts.state().set_up == {"glue": "left", "press": "left"}
            until(lambda: any(decision.what == "set-up" for decision in parts.decisions()), "it hears who decided")
        with parts.with_overall(again=True):
            until(lambda: parts.state().version == 1, "another process takes over")
            assert "set-up" in [decision.what for decision in parts.state().decisions]
    acted = [decision for decision in parts.decisions() if decision.what == "set-up"]
    assert [decision.who for decision in acted] == ["twin of one"], "nothing is written twice"
    assert "the twin of the line does not answer" in acted[0].why


def test_without_the_twin_of_its_zone_work_stays_where_it_is_until_it_is_back(
    parts: Parts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(overall, "HEARD", 3.0)
    with ExitStack() as stack:
        first = stack.enter_context(ExitStack())
        first.enter_context(parts.with_zone())
        stack.enter_context(parts.with_overall())
        first.close()
        until(lambda: parts.decisions()[-1:] and parts.decisions()[-1].what == "no answer", "it is missed")
        parts.bus.ask(LINE_STOP, StationWord("ada", "it smokes", "right"), LineState)
        until(lambda: parts.decisions()[-1].what == "none possible", "nobody knows what its other stations can do")
        assert parts.plant().version == 0
        stack.enter_context(parts.with_zone())
        until(lambda: parts.plant().set_up["press"] == "left", "it is back, and the work moves")
    kinds = [decision.what for decision in parts.decisions()]
    assert kinds[:3] == ["no answer", "stop", "none possible"]
    assert "answers again" in kinds


def test_an_arm_of_a_line_is_seen_like_that_of_a_cell(parts: Parts) -> None:
    seen: list[Sensors] = []
    paths: list[PathAngles] = []
    arm = parts.bus.beside("left")
    arm.subscribe(SENSORS, Sensors, seen.append)
    arm.subscribe(PATH, PathAngles, paths.append)
    until(lambda: len(seen) > 300 and len(paths) > 300, "samples and paths come")
    numbers = [sample.sequence for sample in seen]
    assert numbers == sorted(set(numbers))
    assert all(abs(sample.time - 0.01 * sample.sequence) < 1e-9 for sample in seen)
    assert {path.sequence for path in paths} & set(numbers)


def test_a_plant_keeps_how_it_goes_and_one_that_begins_anew_writes_over_nothing(parts: Parts, tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    history = LineFile(prepare(folder), Decision, "a decision of the line")
    history.append(Decision(1.0, "ada", "stop", "it smokes", "left"))
    floor = Floor(parts.line)
    keeper = Keeper(floor, folder)
    for _ in range(600):
        floor.step()
        floor.record()
    keeper.look()
    assert not (folder / COURSE).exists(), "it is not due yet"
    keeper.write()
    found = read(folder)
    assert (found.duration, len(found.samples), [each.who for each in found.decisions]) == (60.0, 600, ["ada"])
    assert ask("select count(*) from events where kind = 'entered'", [folder]).rows == [(found.entered,)]
    again = Keeper(Floor(parts.line), folder)
    again.write()
    assert again.folder == folder / "again-1"
    assert read(folder) == found
