"""A journal keeps what a killed emulator was told."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import RecordingError
from dtwin.services.parts.journal import MAGIC, RETRY, ROTATION, Entry, Journal, carry_over
from dtwin.services.parts.latch import Latched
from tests.support.disks import full_disk

volts = st.floats(-8, 8)
commands = st.tuples(st.tuples(volts, volts, volts, volts), st.booleans())
entries = st.lists(commands | st.text(max_size=20), max_size=20)


def write(path: Path, seed: int, content: list[Entry]) -> None:
    journal = Journal(path, seed)
    for entry in content:
        if isinstance(entry, str):
            journal.fault(entry)
        else:
            journal.command(*entry)
    journal.close()


@given(st.data(), entries, st.integers(0, 2**64 - 1))
def test_whole_records_survive_a_cut_anywhere(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, content: list[Entry], seed: int
) -> None:
    path = tmp_path_factory.mktemp("journal") / "journal"
    write(path, seed, content)
    whole = path.read_bytes()
    lengths = [len(whole)]
    for k in range(len(content)):
        path.unlink()
        write(path, seed, content[:k])
        lengths.append(path.stat().st_size)
    cut = data.draw(st.integers(min(lengths), len(whole)))
    path.write_bytes(whole[:cut])
    journal = Journal(path, 0)
    kept = journal.entries()
    assert journal.seed == seed
    assert kept == content[: len(kept)]
    assert len(kept) == sum(1 for length in sorted(lengths)[1:] if length <= cut)
    journal.fault("more")
    journal.close()
    assert Journal(path, 0).entries() == [*kept, "more"]


def test_restart_forgets_all_but_the_new_seed(tmp_path: Path) -> None:
    write(tmp_path / "j", 1, ["a"])
    journal = Journal(tmp_path / "j", 1)
    journal.restart(9)
    journal.close()
    again = Journal(tmp_path / "j", 0)
    assert (again.seed, again.entries()) == (9, [])


def test_another_file_is_refused_and_kept(tmp_path: Path) -> None:
    path = tmp_path / "notes"
    path.write_bytes(b"something else, and long enough to be one")
    with pytest.raises(RecordingError, match="expected a journal"):
        Journal(path, 0)
    assert path.read_bytes().startswith(b"something else")


def test_a_journal_of_the_earlier_layout_is_read(tmp_path: Path) -> None:
    path = tmp_path / "j"
    write(path, 7, ["a", ((1.0, 2.0, 3.0, 4.0), True)])
    content = path.read_bytes()
    stop = 10
    earlier = content[: len(MAGIC) + 8] + content[len(MAGIC) + 8 + stop :]
    path.write_bytes(earlier.replace(MAGIC, b"dtwin journal 1\n"))
    journal = Journal(path, 0)
    assert (journal.seed, journal.latched) == (7, Latched())
    assert journal.entries() == ["a", ((1.0, 2.0, 3.0, 4.0), True)]
    journal.latch(Latched(1, "standstill"))
    journal.close()
    assert Journal(path, 0).latched == (1, "standstill")
    assert path.read_bytes().startswith(MAGIC)


@pytest.mark.parametrize("latched", [Latched(), Latched(3), Latched(3, "standstill")])
def test_what_is_left_of_a_killed_run_is_its_stop(tmp_path: Path, latched: Latched) -> None:
    path = tmp_path / "j"
    journal = Journal(path, 1)
    journal.fault("a")
    journal.latch(latched)
    journal.close()
    carry_over(path, 9)
    assert path.exists() == (latched.stop != "none")
    if path.exists():
        again = Journal(path, 0)
        assert (again.seed, again.latched, again.entries()) == (9, latched, [])
    carry_over(tmp_path / "missing", 9)
    assert not (tmp_path / "missing").exists()


def test_an_unreadable_journal_may_have_held_a_stop(tmp_path: Path) -> None:
    path = tmp_path / "j"
    path.write_bytes(b"something else, and long enough to be one")
    carry_over(path, 9)
    assert Journal(path, 0).latched == (1, "torque off")
    assert (tmp_path / "j.unreadable").read_bytes().startswith(b"something else")


COMMAND = ((1.0, -2.0, 0.5, 3.0), True)


def test_a_checkpoint_is_due_in_time_and_takes_the_place_of_what_came_before(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "j", 4)
    due = []
    for _ in range(ROTATION):
        due.append(journal.due)
        journal.command(*COMMAND)
    due.append(journal.due)
    journal.checkpoint(b"state")
    due.append(journal.due)
    assert due == [*[False] * ROTATION, True, False]
    journal.fault("later")
    journal.close()
    again = Journal(tmp_path / "j", 0)
    assert (again.seed, again.entries()) == (4, [b"state", "later"])
    assert (tmp_path / "j").stat().st_size < 100
    assert again.news == []


def test_a_full_disk_costs_what_it_cannot_take_until_there_is_room(tmp_path: Path) -> None:
    path = tmp_path / "j"
    journal = Journal(path, 4)
    journal.command(*COMMAND)
    room = path.stat().st_size + 10
    with full_disk(room):
        for _ in range(RETRY):
            journal.command(*COMMAND)
        due = [journal.due]
        journal.checkpoint(bytes(room))
        journal.fault("not noted")
    assert len(journal.news) == 1
    assert "File too large" in journal.news[0]
    assert Journal(path, 0).entries() == [COMMAND], "half a record is cut off, and no later one follows it"
    assert [file.name for file in tmp_path.iterdir()] == ["j"]
    for _ in range(RETRY):
        due.append(journal.due)
        journal.command(*COMMAND)
    assert due == [True, *[False] * RETRY]
    assert Journal(path, 0).entries() == [COMMAND], "a record is missing, so none is added before a checkpoint"
    journal.checkpoint(b"state")
    journal.fault("noted")
    assert Journal(path, 0).entries() == [b"state", "noted"]
    assert len(journal.news) == 2
    assert "again" in journal.news[1]


def test_a_new_run_on_a_full_disk_does_not_leave_the_old_one(tmp_path: Path) -> None:
    write(tmp_path / "j", 4, ["old"])
    journal = Journal(tmp_path / "j", 0)
    with full_disk(0):
        journal.restart(5)
        journal.command(*COMMAND)
    journal.command(*COMMAND)
    assert Journal(tmp_path / "j", 7).entries() == []


def test_a_journal_begins_on_a_full_disk(tmp_path: Path) -> None:
    with full_disk(0):
        journal = Journal(tmp_path / "j", 4)
        journal.command(*COMMAND)
    assert len(journal.news) == 1
    journal.checkpoint(b"state")
    again = Journal(tmp_path / "j", 0)
    assert (again.seed, again.entries()) == (4, [b"state"])


def test_a_stop_on_a_full_disk_is_kept_at_the_cost_of_the_ticks(tmp_path: Path) -> None:
    path = tmp_path / "j"
    journal = Journal(path, 4)
    journal.command(*COMMAND)
    with full_disk(path.stat().st_size):
        journal.latch(Latched(1, "torque off"))
        assert Journal(path, 0).latched == (1, "torque off")
        journal.restart(5)
    again = Journal(path, 0)
    assert (again.seed, again.latched, again.entries()) == (5, (1, "torque off"), [])
    journal.checkpoint(b"state")
    assert Journal(path, 0).latched == (1, "torque off")
