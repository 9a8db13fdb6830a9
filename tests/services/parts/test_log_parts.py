"""A log that is written in parts and survives its writer."""

import math
from pathlib import Path

import pytest

from dtwin.errors import RecordingError
from dtwin.logs.collecting import RunLog
from dtwin.logs.files import join_logs
from dtwin.logs.log import Log, concatenate
from dtwin.logs.reading import read_log
from dtwin.services.parts import log_parts
from dtwin.services.parts.log_parts import MERGED, WAITING_LIMIT, Parts, Span
from dtwin.services.parts.part_files import SUFFIX
from dtwin.signals import Event, Sensors, StepRecord, Truth, Voltages
from tests.support.disks import full_disk


def log(first: int, last: int) -> Log:
    collected = RunLog()
    for k in range(first, last):
        t = 0.01 * k
        sample = Sensors(k, t, (t, 0.0, 0.0), 0.9, k > 5, "red" if k > 5 else "")
        truth = Truth(t, (t, 0.0, 0.0), (0.0, 0.0, 0.0), 0.9, 0.0)
        collected.append(StepRecord(truth, sample, (t, 0.0, 0.0), Voltages(k, t, (1.0, 0.0, 0.0, 3.0), False)))
    collected.add_events([Event(0.01 * first, "arrived", "")])
    return collected.freeze()


def folder(tmp_path: Path) -> Path:
    return tmp_path / f"run.parquet{SUFFIX}"


def names(tmp_path: Path) -> list[str]:
    return sorted(file.name for file in folder(tmp_path).iterdir())


def test_parts_of_two_writers_become_the_log_of_one(tmp_path: Path) -> None:
    killed = Parts(tmp_path / "run.parquet")
    killed.add(log(0, 4))
    killed.add(log(4, 10))
    again = Parts(tmp_path / "run.parquet")
    assert (again.rows, again.last) == (10, 0.09)
    again.add(log(10, 11))
    assert again.finish({"seed": 3})
    assert not folder(tmp_path).exists()
    found = read_log(tmp_path / "run.parquet")
    assert found.columns["t"].tolist() == [0.01 * k for k in range(11)]
    assert [event.time for event in found.events] == [0.0, 0.04, 0.1]
    assert found.metadata == {"seed": 3}


def test_a_log_that_was_finished_too_early_goes_on(tmp_path: Path) -> None:
    parts = Parts(tmp_path / "run.parquet")
    parts.add(log(0, 10))
    parts.finish({"seed": 3})
    parts.mark_whole()
    again = Parts(tmp_path / "run.parquet")
    assert (again.rows, again.last) == (10, pytest.approx(0.09))
    assert not (tmp_path / "run.parquet").exists()
    again.add(log(12, 20))
    again.finish({"seed": 3})
    assert read_log(tmp_path / "run.parquet").columns["t"] == pytest.approx(
        [0.01 * k for k in range(20) if k not in (10, 11)]
    )
    Parts(tmp_path / "run.parquet")
    assert len(read_log(tmp_path / "run.parquet")) == 18, "the log of another run stays until there is a new one"


def test_every_part_can_be_read_while_the_run_goes_on(tmp_path: Path) -> None:
    parts = Parts(tmp_path / "run.parquet")
    parts.add(log(0, 8))
    (file,) = folder(tmp_path).glob("*.parquet")
    assert len(read_log(file)) == 8
    found = parts.read(5)
    assert found is not None
    rest, end = found
    assert rest.columns["t"].tolist() == [0.05, 0.06, 0.07]
    assert (rest.events, end) == ((), 8)
    assert parts.read(8) is None


def test_a_run_without_rows_leaves_nothing(tmp_path: Path) -> None:
    parts = Parts(tmp_path / "run.parquet")
    parts.add(log(0, 2))
    parts.clear()
    assert not parts.finish({})
    assert list(tmp_path.iterdir()) == []


def test_many_parts_are_merged_and_give_the_bytes_of_one_log(tmp_path: Path) -> None:
    parts, pieces = Parts(tmp_path / "run.parquet"), [log(3 * k, 3 * k + 3) for k in range(3 * MERGED)]
    for piece in pieces:
        parts.add(piece)
        assert len(names(tmp_path)) <= MERGED
    parts.finish({"seed": 3})
    concatenate(pieces, {"seed": 3}).write_parquet(tmp_path / "expected")
    assert (tmp_path / "run.parquet").read_bytes() == (tmp_path / "expected").read_bytes()


def test_a_large_part_is_merged_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_parts, "LARGE", 2 * MERGED)
    parts = Parts(tmp_path / "run.parquet")
    for k in range(2 * MERGED):
        parts.add(log(2 * k, 2 * k + 2))
    assert names(tmp_path) == [Span(first, 2 * MERGED).name for first in (0, 2 * MERGED)]


@pytest.mark.parametrize("removed", [0, 5])
def test_a_kill_in_a_merge_loses_nothing_and_doubles_nothing(tmp_path: Path, removed: int) -> None:
    parts = Parts(tmp_path / "run.parquet")
    for k in range(10):
        parts.add(log(2 * k, 2 * k + 2))
    files = sorted(folder(tmp_path).iterdir())
    join_logs(files, folder(tmp_path) / Span(0, 20).name, {})
    for file in files[:removed]:
        file.unlink()
    (folder(tmp_path) / ".half.parquet.77.part").write_bytes(b"half")
    again = Parts(tmp_path / "run.parquet")
    assert names(tmp_path) == [Span(0, 20).name]
    again.add(log(20, 21))
    again.finish({})
    assert len(read_log(tmp_path / "run.parquet")) == 21


def test_an_unreadable_part_is_left_out_and_kept(tmp_path: Path) -> None:
    parts = Parts(tmp_path / "run.parquet")
    parts.add(log(0, 4))
    parts.add(log(4, 6))
    (folder(tmp_path) / Span(4, 2).name).write_bytes(b"")
    again = Parts(tmp_path / "run.parquet")
    assert again.last == 0.03
    again.add(log(6, 7))
    again.finish({})
    assert read_log(tmp_path / "run.parquet").columns["t"].tolist() == [0.0, 0.01, 0.02, 0.03, 0.06]


def test_what_a_full_disk_does_not_take_is_written_when_there_is_room(tmp_path: Path) -> None:
    parts = Parts(tmp_path / "run.parquet")
    parts.add(log(0, 4))
    with full_disk(1000):
        for k in range(4, 40):
            parts.add(log(k, k + 1))
    assert parts.rows == 4
    assert parts.waiting == 36
    assert len(parts.news) == 1
    assert "File too large" in parts.news[0]
    assert names(tmp_path) == [Span(0, 4).name], "no half a file"
    parts.add(log(40, 41))
    assert parts.waiting == 0
    assert parts.news[1:] == ["the log is written again"]
    parts.finish({})
    found = read_log(tmp_path / "run.parquet")
    assert found.columns["t"].tolist() == [0.01 * k for k in range(41)]
    assert len(found.events) == 38


def test_waiting_rows_are_bounded_and_the_gap_is_told(tmp_path: Path) -> None:
    step = WAITING_LIMIT // 8
    pieces = [log(step * k, step * (k + 1)) for k in range(12)]
    parts = Parts(tmp_path / "run.parquet")
    parts.add(pieces[0])
    with full_disk(1000):
        for piece in pieces[1:]:
            parts.add(piece)
            assert parts.waiting <= WAITING_LIMIT
    assert [said.rpartition(": ")[2] for said in parts.news[1:]] == ["the oldest are lost from now on"]
    parts.add(log(12 * step, 12 * step + 1))
    missing = 3 * step
    gap = f"from {step * 0.01:.2f} s to {(step + missing - 1) * 0.01:.2f} s"
    assert parts.news[-1] == f"the log is written again; {missing} rows {gap} are missing"
    parts.finish({})
    assert len(read_log(tmp_path / "run.parquet")) == 9 * step + 1


def test_a_log_begins_on_a_full_disk(tmp_path: Path) -> None:
    with full_disk(0):
        parts = Parts(tmp_path / "run.parquet")
        parts.add(log(0, 4))
    assert parts.last == -math.inf
    parts.add(log(4, 5))
    assert parts.finish({})
    assert len(read_log(tmp_path / "run.parquet")) == 5


def test_an_end_on_a_full_disk_leaves_the_parts(tmp_path: Path) -> None:
    parts = Parts(tmp_path / "run.parquet")
    parts.add(log(0, 4))
    with full_disk(1000), pytest.raises(RecordingError, match="File too large"):
        parts.finish({})
    assert names(tmp_path) == [Span(0, 4).name]
    assert not (tmp_path / "run.parquet").exists()
