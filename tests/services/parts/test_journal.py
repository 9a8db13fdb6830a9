"""A journal keeps what a killed emulator was told."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import RecordingError
from services.parts.journal import MAGIC, Entry, Journal, carry_over
from services.parts.latch import Latched

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
