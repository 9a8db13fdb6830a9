"""The recorder on a disk that is full for a while, with many parts of an earlier one, and over long runs."""

import os
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from dtwin.bus.messages import Path as PathAngles
from dtwin.errors import ModelError
from dtwin.logs.log import Log
from dtwin.logs.reading import read_log
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.services.parts.part_files import discard_markers, mark_begun
from dtwin.services.recorder import Options, Recorder
from dtwin.signals import Event, EventKind, Sensors, Truth, Voltages
from dtwin.view import live, saving
from tests.services.parts.test_log_parts import log as rows_of
from tests.support.desk import Desk
from tests.support.disks import full_disk
from tests.support.waiting import until
from tests.view.test_write import contents


def feed(recorder: Recorder, first: int, last: int) -> None:
    """The messages of some ticks, which are kept at the end."""
    for tick in range(first, last):
        now, colour = tick * PERIOD, "red" if tick % 7 > 3 else ""
        recorder.rows.sensors(Sensors(tick, now, (0.1, 0.2, 0.3), 0.9, colour != "", colour), now)
        recorder.rows.truth(Truth(now, (0.1, 0.2, 0.3), (0.0, 0.0, 0.0), 0.9, 0.0), now)
        recorder.rows.answer(Voltages(tick, now, (1.0, 0.0, 0.0, 3.0), False), now)
        recorder.rows.answer(PathAngles(tick, now, (0.1, 0.2, 0.3)), now)
    recorder.keep()


def recorder_of(folder: Path, told: list[Event], **options: Any) -> Recorder:
    return Recorder(Options(log=folder / "run.parquet", **options), {}, ArmParameters(), told.append)


def test_an_event_that_comes_after_the_last_row_was_kept_is_in_the_log(tmp_path: Path) -> None:
    recorder = recorder_of(tmp_path, [])
    feed(recorder, 0, 50)
    late = Event(0.49, EventKind.DELIVERED, "delivered the red box")
    recorder.take_event(late, 1.0)
    recorder.keep()
    recorder.close()
    found = read_log(tmp_path / "run.parquet")
    assert (len(found), found.events) == (50, (late,))


def test_a_recorder_on_a_full_disk_goes_on_tells_once_and_catches_up(tmp_path: Path) -> None:
    told: list[Event] = []
    recorder = recorder_of(tmp_path, told)
    feed(recorder, 0, 50)
    with full_disk(1000):
        for k in range(1, 9):
            feed(recorder, 50 * k, 50 * k + 50)
    assert [event.kind for event in told] == ["disk"]
    feed(recorder, 450, 500)
    assert [event.kind for event in told] == ["disk"] * 2
    recorder.close()
    assert len(read_log(tmp_path / "run.parquet")) == 500
    assert [file.name for file in tmp_path.iterdir()] == ["run.parquet"]


def test_a_recorder_that_begins_and_ends_on_a_full_disk_leaves_nothing_half(tmp_path: Path) -> None:
    told: list[Event] = []
    with full_disk(0):
        recorder = recorder_of(tmp_path, told)
        feed(recorder, 0, 50)
        recorder.close()
    assert not [file for file in tmp_path.rglob("*") if file.is_file()]
    assert "rows are lost" in told[-1].text


def test_a_recording_waits_for_room_and_draws_what_the_log_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = {"free": 0}
    monkeypatch.setattr(saving, "has_room", lambda file: full["free"] > 0)
    drawn: list[int] = []
    add = live.LiveView.add

    def count(view: live.LiveView, log: Log) -> None:
        drawn.append(len(log))
        add(view, log)

    monkeypatch.setattr(live.LiveView, "add", count)
    told: list[Event] = []
    recorder = recorder_of(tmp_path, told, record=tmp_path / "run.rrd")
    feed(recorder, 0, 50)
    feed(recorder, 50, 100)
    assert (len(told), drawn) == (1, [])
    full["free"] = 1
    feed(recorder, 100, 150)
    feed(recorder, 150, 200)
    full["free"] = 0
    feed(recorder, 200, 250)
    feed(recorder, 250, 300)
    assert [event.kind for event in told] == ["disk"] * 3
    full["free"] = 1
    recorder.close()
    assert [event.kind for event in told] == ["disk"] * 4
    assert sum(drawn) == 300, "each row is drawn once"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.parquet", "run.rrd"]


def test_a_recorder_with_thousands_of_parts_is_at_work_within_two_seconds(tmp_path: Path) -> None:
    folder = tmp_path / "run.parquet.parts"
    folder.mkdir()
    rows_of(0, 2).write_parquet(tmp_path / "one")
    for k in range(3000):
        shutil.copyfile(tmp_path / "one", folder / f"{2 * k:09d}-2.parquet")
    began = time.monotonic()
    recorder = recorder_of(tmp_path, [], record=tmp_path / "run.rrd")
    feed(recorder, 6000, 6050)
    assert time.monotonic() - began < 2.0
    assert recorder.rows.late == 0


@pytest.mark.parametrize("killed", ["never", "before", "between", "after"])
def test_a_recorder_that_goes_on_after_a_reset_keeps_the_first_recording(tmp_path: Path, killed: str) -> None:
    """A recording of 100 rows and one of 50; a recorder that is killed loses the row that waits for the next one."""
    log = tmp_path / "run.parquet"

    def recorder() -> Recorder:
        return recorder_of(tmp_path, [], resumable=True)

    working = recorder()
    feed(working, 0, 100)
    if killed == "before":
        working = recorder()
    if killed == "between":
        mark_begun(log, 2)
        working = recorder()
    feed(working, 0, 50)
    if killed == "after":
        working = recorder()
        feed(working, 60, 70)
    working.close()
    recorder().close()
    discard_markers(log)
    assert len(read_log(log)) == (99 if killed in ("before", "between") else 100)
    assert len(read_log(tmp_path / "run-2.parquet")) == (59 if killed == "after" else 50)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run-2.parquet", "run.parquet"]


@pytest.mark.parametrize("reset", [True, False])
def test_a_recorder_without_a_log_writes_over_no_recording_of_an_earlier_one(tmp_path: Path, reset: bool) -> None:
    """Nothing but a log lets a recorder go on with a recording, so each one without a log begins another."""
    record = tmp_path / "run.rrd"
    record.write_text("of an earlier run")

    def recorder() -> Recorder:
        return Recorder(Options(record=record, resumable=True), {}, ArmParameters(), lambda event: None)

    killed = recorder()
    feed(killed, 0, 100)
    if reset:
        feed(killed, 0, 50)
    kept = {file: file.read_bytes() for file in sorted(tmp_path.glob("*.rrd"))}
    assert [file.name for file in kept] == (["run-2.rrd", "run.rrd"] if reset else ["run.rrd"])
    recorder()  # dies before the first row
    working = recorder()
    feed(working, 60, 70)
    working.close()
    discard_markers(record)
    assert all(file.read_bytes().startswith(content) for file, content in kept.items())
    new = {file.name for file in tmp_path.iterdir()} - {file.name for file in kept}
    assert new == {"run-3.rrd" if reset else "run-2.rrd"}


def test_a_recorder_that_is_asked_to_end_alone_loses_nothing(desk: Desk, tmp_path: Path) -> None:
    (tmp_path / "run.parquet").write_text("of an earlier run")
    desk.detach("--pace", "lockstep", "--log", str(tmp_path / "run.parquet"))
    before = desk.tick()
    until(lambda: desk.tick() > before + 300, "the cell runs", 60.0)
    os.kill(desk.find("dtwin.services.recorder"), signal.SIGTERM)

    def is_back() -> bool:
        found = desk.summary()["services"]["recorder"]
        return (found["restarts"], found["state"]) == (1, "running")

    until(is_back, "it starts again", 60.0)  # once: test_log_parts.py merges many parts
    desk.run("down")
    until(lambda: not desk.processes(), "all processes end", 60.0)
    assert [file.name for file in tmp_path.iterdir()] == ["run.parquet"]
    times = read_log(tmp_path / "run.parquet").columns["t"]
    assert times[0] == 0.0
    assert len(times) > 300


def test_a_cell_lives_through_a_full_disk(desk: Desk, tmp_path: Path) -> None:
    desk.detach("--pace", "lockstep", "--log", str(tmp_path / "run.parquet"))
    until(lambda: desk.tick() > 100, "the cell runs", 60.0)
    pids = [desk.find(f"dtwin.services.{name}") for name in ("recorder", "emulator")]
    with full_disk(1000, pids[0]), full_disk(1000, pids[1]):
        before = desk.tick()
        until(lambda: desk.tick() > before + 1000, "the cell goes on", 60.0)
    before = desk.tick()
    until(lambda: desk.tick() > before + 1000, "the cell goes on", 60.0)
    assert {service["restarts"] for service in desk.summary()["services"].values()} == {0}
    desk.run("down")
    until(lambda: not desk.processes(), "all processes end", 60.0)
    times = read_log(tmp_path / "run.parquet").columns["t"]
    assert len(times) == round(times[-1] / PERIOD) + 1, "no row is missing"


def test_the_ghost_is_the_arm_of_the_notes_or_of_a_record(tmp_path: Path) -> None:
    drawn = []
    told: list[dict[str, Any]] = [{}, {"control": {"payload": 0.3}}, {"control": {"model": {"mass": [1, 1, 1]}}}]
    for number, notes in enumerate(told):
        file = tmp_path / f"{number}.rrd"
        recorder = Recorder(Options(record=file), notes, ArmParameters(), lambda event: None)
        feed(recorder, 0, 100)
        recorder.close()
        rows = contents(file)["/cell/plan/ghost/link_3"]["Transform3D:translation"]
        drawn.append([(time, place) for time, _, place in rows])
    assert drawn[0] == drawn[1] != drawn[2]
    with pytest.raises(ModelError, match=r"arm\.json"):
        Recorder(Options(record=file, commissioned=tmp_path / "arm.json"), {}, ArmParameters(), lambda event: None)
