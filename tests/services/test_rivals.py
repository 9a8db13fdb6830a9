"""Strangers on the bus of a running cell change nothing; in one without a key they change as little as can be."""

from __future__ import annotations

import json
import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dtwin.bus.codec import encode
from dtwin.bus.messages import (
    ADJUSTMENT,
    ARM_PREDICT,
    ARM_ROLL_BACK,
    ARM_UPLOAD,
    DECIDE,
    EVENTS,
    IDENTIFY,
    MODEL,
    SENSORS,
    SETTINGS,
    STOP,
    TICKS,
    TOPICS,
    UPLOAD,
    VOLTAGES,
    Acted,
    PassedTick,
    PassedTicks,
    ResetRequest,
    SettingsInForce,
    StopState,
)
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import IdentificationState, Upload
from dtwin.logs.reading import read_log
from dtwin.run.cell import Cell, CellSettings
from dtwin.run.options import ControlOptions
from dtwin.services import runfile
from dtwin.signals import Event, Sensors, Voltages
from tests.support.by_hand import FAR, PATIENCE, ByHand
from tests.support.desk import Desk
from tests.support.waiting import until

DURATION = 13
HIGHEST = (8.0, 8.0, 8.0, 8.0)
ABSENT = ("recovery", "line", "plant", "zone")
"""Who has queries of his own and is not in the cell of these tests."""

OF_OTHER_ARMS = {ADJUSTMENT, MODEL, ARM_UPLOAD, ARM_ROLL_BACK, ARM_PREDICT}
"""Queries of a service that is in the cell, which nobody answers for the thesis's arm."""


class Rival:
    """Answers every sample first, at the highest voltages, and tells of lost voltages and of samples far ahead."""

    def __init__(self, meet: str) -> None:
        self.answered = 0
        self.bus = Bus(open_peer(meet))
        self._command = self.bus.publisher(VOLTAGES)
        self._tell = self.bus.publisher(EVENTS)
        self._forge = self.bus.publisher(SENSORS)
        self.bus.subscribe(SENSORS, Sensors, self._rival)

    def _rival(self, sample: Sensors) -> None:
        if sample.sequence >= FAR:
            return
        self._command(Voltages(sample.sequence, sample.time, HIGHEST, True))
        self._tell(Event(sample.time, "safe", "no valid command in time: the arm gets 0 V"))
        self._forge(Sensors(FAR + sample.sequence, 1e8, (1.0, 1.0, 1.0), 0.9, False, ""))
        self.answered += 1


@contextmanager
def rival_of(cell: str) -> Iterator[list[Rival]]:
    """Joins the cell as soon as it has a run file, beside what the block does."""
    found: list[Rival] = []
    over = threading.Event()

    def join() -> None:
        while not over.wait(0.01):
            up = runfile.find(cell)
            if up is not None:
                found.append(Rival(up.meet))
                return

    thread = threading.Thread(target=join)
    thread.start()
    try:
        yield found
    finally:
        over.set()
        thread.join()
        for rival in found:
            rival.bus.close()


def test_a_rival_without_the_key_changes_no_row(desk: Desk, tmp_path: Path) -> None:
    log = tmp_path / "run.parquet"
    options = ["--pace", "lockstep", "--duration", str(DURATION), "--seed", "5", "--noise", "0.003"]
    options += ["--monitoring", "--identification", "--store", str(tmp_path / "store"), "--log", str(log)]
    with rival_of("cell") as rivals:
        summary = json.loads(desk.up(*options, "--json"))
    (rival,) = rivals
    assert rival.answered > 50 * DURATION
    headless = Cell(CellSettings(DURATION, 5, 0.003, control=ControlOptions().control()))
    headless.run()
    expected, found = headless.log.freeze(), read_log(log)
    assert found.columns.keys() == expected.columns.keys()
    for name, column in expected.columns.items():
        assert found.columns[name].tobytes() == column.tobytes(), name
    kinds = Counter(event.kind for event in found.events)
    assert (kinds["rivals"], kinds["safe"]) == (1, 0)
    assert {name: service["restarts"] for name, service in summary["services"].items()} == dict.fromkeys(
        ("controller", "recorder", "bridge", "identification", "monitoring", "emulator"), 0
    )
    assert [path.name for path in tmp_path.glob("*.parquet")] == ["run.parquet"]
    assert summary["boxes"]["delivered"] == headless.emulation.box_counts.delivered > 0


def test_one_wildcard_query_changes_nothing(desk: Desk, tmp_path: Path) -> None:
    history = tmp_path / "history.jsonl"
    options = ["--pace", "lockstep", "--monitoring", "--simulation", "--history", str(history)]
    options += ["--log", str(tmp_path / "run.parquet")]
    desk.detach(*options, "--identification", "--store", str(tmp_path / "store"))
    up = runfile.require("cell")
    ticks: list[int] = []
    events: list[Event] = []
    with open_peer(up.meet) as session, runfile.join("cell") as bus:
        bus.subscribe(SENSORS, Sensors, lambda sample: ticks.append(sample.sequence))
        bus.subscribe(EVENTS, Event, events.append)
        until(lambda: len(ticks) > 100, "the cell runs", PATIENCE)
        before, entries = _state(bus), history.read_bytes()
        asked = {topic for topic in TOPICS if topic.kind == "query" and topic.sender not in ABSENT}
        queries = {bus.key(topic) for topic in asked - OF_OTHER_ARMS}
        for payload in (b"", encode(ResetRequest(5)), b'{"schema":1}', b'{"schema":1,"run":true,"accept":true}'):

            def answered(payload: bytes = payload) -> bool:
                """Whether every service has answered, and none but by reading."""
                replies = list(session.get("dtwin/**", payload=payload, timeout=10.0))
                assert not (payload and any(reply.ok is not None for reply in replies))
                keys = {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}
                return keys < queries and len(replies) >= len(queries)

            until(answered, "every service answers", PATIENCE)
        count = len(ticks)
        until(lambda: len(ticks) > count + 100, "the cell goes on", PATIENCE)
        assert ticks == sorted(ticks)
        assert _state(bus) == before
        assert history.read_bytes() == entries
        kinds = {event.kind for event in events}
        assert not kinds & {
            "fault",
            "stop",
            "upload",
            "roll back",
            "identification",
            "monitor_acknowledged",
            "rivals",
        }
    assert all(service["restarts"] == 0 for service in desk.summary()["services"].values())


def _state(bus: Bus) -> tuple[Any, ...]:
    stop = bus.ask(STOP, None, StopState).stop
    phases = [bus.ask(topic, None, IdentificationState).phase for topic in (IDENTIFY, DECIDE)]
    return stop, phases, bus.ask(SETTINGS, None, SettingsInForce), bus.ask(UPLOAD, None, Upload)


def test_without_a_key_numbers_far_ahead_and_untimely_events_do_nothing(
    by_hand: ByHand, sockets: str, tmp_path: Path
) -> None:
    management = f"unix:{sockets}/61499"
    by_hand.start("controller", "--listen", management)
    by_hand.start("recorder", "--log", str(tmp_path / "run.parquet"))
    listeners = ("recorder", "bridge", "monitoring", "identification")
    by_hand.start("bridge", "--controller", management, "--lossless", "--wait-for", "recorder")
    by_hand.start("monitoring")
    by_hand.start("identification", "--store", str(tmp_path / "store"))
    waits = [word for name in listeners for word in ("--wait-for", name)]
    by_hand.start("emulator", "--pace", "lockstep", *waits)
    until(lambda: len(by_hand.samples) > 50, "the cell runs", PATIENCE)
    forge, tell = by_hand.bus.publisher(SENSORS), by_hand.bus.publisher(EVENTS)
    forge_passed = by_hand.bus.publisher(TICKS)

    def strayed() -> bool:
        far = Sensors(FAR + len(by_hand.samples), 1e8, (1.0, 1.0, 1.0), 0.9, False, "")
        forge(far)
        forge_passed(PassedTicks((PassedTick(far, Acted(far.sequence, far.time, (0.0, 0.0, 0.0, 0.0), False)),)))
        tell(Event(by_hand.last.time + 1000.0, "safe", ""))
        return all(by_hand.refused(name, "far ahead") for name in listeners)

    until(strayed, "all refuse the numbers far ahead", PATIENCE)
    by_hand.goes_on()
    ticks = {name: by_hand.statuses[name].ticks for name in ("recorder", "bridge", "monitoring")}
    until(lambda: all(by_hand.statuses[n].ticks > k for n, k in ticks.items()), "and all go on", PATIENCE)
    assert "planned anew" not in by_hand.statuses["bridge"].last_error
    assert not [path.name for path in tmp_path.glob("run-*")]

    def replanned() -> bool:
        tell(Event(by_hand.last.time, "safe", ""))
        return "planned anew" in by_hand.statuses["bridge"].last_error

    until(replanned, "an event at the time of the last sample counts", PATIENCE)


def test_recordings_of_one_run_are_bounded(by_hand: ByHand, tmp_path: Path) -> None:
    by_hand.start("recorder", "--log", str(tmp_path / "run.parquet"))
    until(lambda: "recorder" in by_hand.statuses, "the recorder is there", PATIENCE)
    forge = by_hand.bus.publisher(SENSORS, lossless=True)

    def told() -> bool:
        for sequence in (1, 0):
            forge(Sensors(sequence, 0.01 * sequence, (0.0, 0.0, 0.0), 0.9, False, ""))
        return any(event.kind == "recording" for event in by_hand.events)

    until(told, "no further recording is begun", PATIENCE)
    until(lambda: "nothing is recorded any more" in by_hand.statuses["recorder"].last_error, "its status says so")
    for _ in range(100):
        told()
    until(lambda: not (tmp_path / "run-51.parquet.parts").exists(), "there are no more")
    assert [event.kind for event in by_hand.events].count("recording") == 1
