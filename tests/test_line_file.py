"""Files of lines through full and broken disks, kills in the middle of a write, several writers, and tampering."""

import errno
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dtwin.console.alarms.journal import Change, Journal
from dtwin.console.alarms.states import Alarm
from dtwin.console.people.audit import Audit, AuditEntry
from dtwin.controller.settings import ControlSettings
from dtwin.errors import DtwinError, NoSpaceError, RecordingError
from dtwin.line_file import LineFile
from dtwin.simulation.history import Entry, History
from tests.support.disks import full_disk
from tests.support.notes import Note, notes


def filled(folder: Path, count: int = 5, **options: Any) -> LineFile[Note]:
    """A file of notes."""
    file = notes(folder / "notes.jsonl", **options)
    for number in range(count):
        file.append(Note(number, "some text"))
    return file


WRITERS: dict[str, Callable[[Path], Callable[[int], None]]] = {
    "history": lambda path: (
        lambda number: History(path).append(Entry(number, 1.0, "upload", "ann", "to try", "gains", ControlSettings()))
    ),
    "audit": lambda path: (
        lambda number: Audit(path).append(
            AuditEntry(1.0, 1.0, "ann", "operator", "s", "", "stop", {"number": number}, True, "")
        )
    ),
    "notes": lambda path: lambda number: notes(path).append(Note(number)),
}
"""By what is written: makes a function that appends an entry to a file."""


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """A disk that takes at most `take` bytes at a time, and fails with `error` after `room` bytes, or when synced."""
    state = {"take": 1 << 20, "room": 1 << 20, "error": 0, "sync": 0}
    write, sync = os.write, os.fsync

    def writes(file: int, data: Any) -> int:
        taken = min(len(data), state["take"], state["room"])
        if not taken:
            raise OSError(state["error"], os.strerror(state["error"]))
        state["room"] -= taken
        return write(file, bytes(data[:taken]))

    def syncs(file: int) -> None:
        if state["sync"]:
            raise OSError(state["sync"], os.strerror(state["sync"]))
        sync(file)

    monkeypatch.setattr(os, "write", writes)
    monkeypatch.setattr(os, "fsync", syncs)
    return state


@pytest.mark.parametrize("kind", WRITERS)
def test_a_disk_that_takes_a_part_at_a_time_takes_all(tmp_path: Path, kind: str, disk: dict[str, int]) -> None:
    append = WRITERS[kind](tmp_path / "f.jsonl")
    disk["take"] = 7
    for number in range(3):
        append(number)
    assert [json.loads(line)["line"] for line in (tmp_path / "f.jsonl").read_text().splitlines()] == [1, 2, 3]


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_what_is_not_written_whole_is_an_error_and_nothing_of_it_is_there(
    tmp_path: Path, kind: str, error: int, disk: dict[str, int]
) -> None:
    path = tmp_path / "f.jsonl"
    append = WRITERS[kind](path)
    append(0)
    before = path.read_bytes()
    for room in (0, 1, 40):
        disk |= {"room": room, "error": error}
        with pytest.raises(NoSpaceError if error != errno.EIO else RecordingError, match="cannot be written"):
            append(1)
        assert path.read_bytes() == before
    disk |= {"room": 1 << 20, "sync": error}
    with pytest.raises(RecordingError, match="cannot be written"):
        append(1)
    assert path.read_bytes() == before
    disk["sync"] = 0
    append(1)
    assert path.read_bytes().startswith(before)
    assert path.read_bytes().count(b"\n") == 2


@pytest.mark.parametrize("kind", WRITERS)
def test_on_a_disk_that_fills_up_all_that_counted_as_written_is_there(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "f.jsonl"
    append = WRITERS[kind](path)
    append(0)
    written = 1
    with full_disk(3 * path.stat().st_size + 20):
        for number in range(1, 9):
            try:
                append(number)
            except NoSpaceError:
                continue
            written += 1
    assert path.read_bytes().endswith(b"}\n")
    assert 1 < written < 9
    assert path.read_bytes().count(b"\n") == written


def test_alarms_that_find_no_room_are_written_when_there_is_some(tmp_path: Path) -> None:
    path = tmp_path / "alarms.jsonl"
    journal = Journal(path)
    journal.add(Change(1, 0.0, "raised", Alarm("it", "bang")))
    with full_disk(path.stat().st_size + 20):
        journal.add(Change(2, 1.0, "cleared", Alarm("it", "bang")))
        assert "cannot be written" in journal.trouble
        assert [change.number for change in Journal(path).changes] == [1]
    journal.add(Change(3, 2.0, "raised", Alarm("it", "bang")))
    assert journal.trouble == ""
    assert [change.number for change in Journal(path).changes] == [1, 2, 3]


KILLED = """
import os, sys
from pathlib import Path
from tests.support.notes import Note, notes

write = os.write
def write_half(file, data):
    write(file, bytes(data[: int(sys.argv[2])]))
    os.kill(os.getpid(), 9)
file = notes(Path(sys.argv[1]))
os.write = write_half
file.append(Note(5, "killed"))
"""


@pytest.mark.parametrize("length", [1, 30, 10_000])
def test_a_writer_that_is_killed_in_the_middle_leaves_all_or_nothing_that_counts(
    tmp_path: Path, length: int, caplog: pytest.LogCaptureFixture
) -> None:
    file = filled(tmp_path)
    before = file.path.read_bytes()
    command = [sys.executable, "-c", KILLED, str(file.path), str(length)]
    assert subprocess.run(command, timeout=60, check=False).returncode == -9
    left = file.path.read_bytes().removeprefix(before)
    whole = left.endswith(b"\n")
    assert len(file.entries()) == 5 + whole
    assert ("6: this line was cut off" in caplog.text) is not whole
    caplog.clear()
    file.append(Note(6))
    assert [note.number for note in file.entries()] == [0, 1, 2, 3, 4, *([5] if whole else []), 6]
    assert not file.verify().faults
    damaged = tmp_path / "notes.jsonl.damaged"
    assert damaged.exists() is not whole
    if not whole:
        assert damaged.read_bytes() == left + b"\n"
        assert f"{len(left)} bytes are kept in notes.jsonl.damaged" in caplog.text


@pytest.mark.parametrize("tail", [b"\0" * 5000, b'{"schema":1,"num', b"\xff\xfe\n", b"some words\nmore\n", b"}\n"])
def test_what_a_lost_disk_left_at_the_end_is_kept_aside(tmp_path: Path, tail: bytes) -> None:
    file = filled(tmp_path)
    with file.path.open("ab") as raw:
        raw.write(tail)
    assert len(file.entries()) == 5
    file.append(Note(5))
    assert [note.number for note in file.entries()] == [0, 1, 2, 3, 4, 5]
    assert (tmp_path / "notes.jsonl.damaged").read_bytes() == tail + b"\n"


def test_a_file_without_a_whole_line_is_begun_anew(tmp_path: Path) -> None:
    file = notes(tmp_path / "notes.jsonl")
    file.path.write_bytes(b"x" * 20_000)
    assert file.entries() == []
    file.append(Note(1))
    assert file.entries() == [Note(1)]
    assert not file.verify().faults


def test_lines_of_earlier_versions_count(tmp_path: Path) -> None:
    file = notes(tmp_path / "notes.jsonl")
    file.path.write_bytes(b'{"schema":1,"number":1}\n{"schema":1,"number":2}\n')
    file.append(Note(3))
    assert [note.number for note in file.entries()] == [1, 2, 3]
    chain = file.verify()
    assert (chain.lines, chain.unsealed, chain.seal.line, chain.faults) == (3, 2, 3, ())
    file.path.write_bytes(file.path.read_bytes().replace(b'"number":2}', b'"number":7}'))
    assert "line 3" not in str(file.verify().faults)
    assert len(file.verify().faults) == 1


@settings(deadline=None)
@given(place=st.integers(0, 10_000), value=st.integers(0, 255))
def test_no_changed_byte_goes_unseen(place: int, value: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = filled(Path(folder), marked=True)
        content = bytearray(file.path.read_bytes())
        place %= len(content)
        if content[place] == value:
            return
        content[place] = value
        file.path.write_bytes(content)
        assert file.verify().faults


@settings(deadline=None)
@given(st.integers(0, 4), st.integers(1, 5))
def test_no_line_that_was_taken_out_goes_unseen(first: int, count: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = filled(Path(folder), marked=True)
        lines = file.path.read_bytes().splitlines(keepends=True)
        del lines[first : first + count]
        file.path.write_bytes(b"".join(lines))
        assert any("missing" in fault for fault in file.verify().faults)
        file.append(Note(9))
        assert any("missing" in fault for fault in file.verify().faults), "what is written later hides nothing"


def test_lines_that_are_swapped_or_doubled_are_seen(tmp_path: Path) -> None:
    file = filled(tmp_path, marked=True)
    lines = file.path.read_bytes().splitlines(keepends=True)
    for wrong in (lines[:2] + lines[1:], [lines[1], lines[0], *lines[2:]], [*lines, lines[0]]):
        file.path.write_bytes(b"".join(wrong))
        assert file.verify().faults
        with pytest.raises(RecordingError, match=r"notes\.jsonl:\d: expected a note as it was written: "):
            file.entries()


def test_a_file_that_grows_has_a_bounded_size_and_its_lines_hang_together(tmp_path: Path) -> None:
    file = filled(tmp_path, 60, largest=500, older=2, marked=True)
    assert {path.name for path in tmp_path.iterdir()} == {f"notes.jsonl{end}" for end in ("", ".1", ".2", ".end")}
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 3 * 700
    numbers = [note.number for note in file.entries()]
    assert numbers == list(range(numbers[0], 60))
    assert not file.verify().faults
    (tmp_path / "notes.jsonl.1").unlink()
    assert any("missing" in fault for fault in file.verify().faults)


def test_a_full_disk_leaves_the_files_as_they_are_also_when_a_new_one_is_due(tmp_path: Path) -> None:
    file = filled(tmp_path, 8, largest=500, older=1)
    while file.path.stat().st_size < 500:
        file.append(Note(8))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with full_disk(20), pytest.raises(NoSpaceError):
        file.append(Note(9))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    file.append(Note(9))
    assert file.entries()[-1] == Note(9)


WRITER = """
import sys
from pathlib import Path
from tests.support.notes import Note, notes

file = notes(Path(sys.argv[1]), largest=2000, older=50)
for number in range(30):
    file.append(Note(number, sys.argv[2]))
"""


def test_several_writers_make_one_chain(tmp_path: Path) -> None:
    path = tmp_path / "notes.jsonl"
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, str(path), name]) for name in "ab"]
    assert [writer.wait(60) for writer in writers] == [0, 0]
    file = notes(path, largest=2000, older=50)
    assert not file.verify().faults
    found = file.entries()
    assert [note.number for note in found if note.text == "a"] == list(range(30))
    assert [note.number for note in found if note.text == "b"] == list(range(30))


def test_a_writer_that_hangs_holds_nobody_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dtwin.line_file.PATIENCE", 0.05)
    file = filled(tmp_path)
    with file._locked(os.O_RDWR):
        for act in (lambda: file.append(Note(9)), file.entries):
            with pytest.raises(DtwinError, match="another process has locked it"):
                act()
    assert len(file.entries()) == 5


def test_nobody_else_reads_the_audit(tmp_path: Path) -> None:
    WRITERS["audit"](tmp_path / "a.jsonl")(1)
    assert {path.stat().st_mode & 0o077 for path in tmp_path.iterdir()} == {0}
