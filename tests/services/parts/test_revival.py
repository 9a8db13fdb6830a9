"""A cell comes back from its journal, and starts anew where the journal cannot be read."""

import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st

from dtwin.errors import ModelError
from dtwin.run.cell import CellSettings
from dtwin.services.parts.journal import MAGIC, Journal
from dtwin.services.parts.journaled import JournaledCell
from dtwin.services.parts.revival import KEPT, revive
from dtwin.signals import Sensors
from tests.support.examples import examples

HEAD = MAGIC + struct.pack("<Q", 3)
DIVERGING = struct.pack("<c4d?", b"V", *4 * [1e300], False)
BROKEN = {
    "another file": b"something else, and long enough to be one",
    "seed out of range": MAGIC + struct.pack("<Q", 2**64 - 1),
    "no text": HEAD + b"F\x02\x00\xff\xff",
    "no fault": HEAD + b"F\x03\x00abc",
    "not finite": HEAD + struct.pack("<c4d?", b"V", *4 * [float("nan")], False),
    "diverging": HEAD + 3 * DIVERGING,
}


def sample(cell: JournaledCell) -> Sensors:
    return cell.emulation.read()


def test_a_journal_that_can_be_read_is_replayed(tmp_path: Path) -> None:
    cell, trouble = revive(CellSettings(seed=7, noise=0.01), tmp_path / "journal")
    assert trouble == ""
    for _ in range(20):
        cell.advance()
    again, trouble = revive(CellSettings(noise=0.01), tmp_path / "journal")
    assert trouble == ""
    assert (again.seed, again.replayed, sample(again)) == (7, 20, sample(cell))


@pytest.mark.parametrize("content", BROKEN.values(), ids=BROKEN.keys())
def test_a_journal_that_cannot_be_read_is_kept_and_the_cell_starts_anew(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "journal"
    path.write_bytes(content)
    cell, trouble = revive(CellSettings(seed=5), path)
    assert "journal.unreadable-1" in trouble
    assert (tmp_path / "journal.unreadable-1").read_bytes() == content
    assert (cell.seed, cell.replayed, sample(cell).sequence) == (5, 0, 0)
    assert Journal(path, 0).seed == 5


@examples(30, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.binary(max_size=200) | st.binary(max_size=200).map(HEAD.__add__))
def test_no_content_keeps_the_cell_from_starting(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "journal").write_bytes(content)
    cell, _ = revive(CellSettings(), tmp_path / "journal")
    cell.advance()


def test_only_so_many_are_kept(tmp_path: Path) -> None:
    for number in range(KEPT + 3):
        (tmp_path / "journal").write_bytes(BROKEN["another file"] + bytes([number]))
        revive(CellSettings(), tmp_path / "journal")
    assert len(list(tmp_path.iterdir())) == KEPT + 1
    assert (tmp_path / "journal.unreadable-1").read_bytes()[-1] == 0


def test_settings_that_cannot_be_used_leave_the_journal_alone(tmp_path: Path) -> None:
    (tmp_path / "journal").write_bytes(BROKEN["another file"])
    with pytest.raises(ModelError):
        revive(CellSettings(model_file=tmp_path / "none.xml"), tmp_path / "journal")
    assert [path.name for path in tmp_path.iterdir()] == ["journal"]


def test_a_reset_with_a_seed_out_of_range_changes_nothing(tmp_path: Path) -> None:
    cell, _ = revive(CellSettings(seed=7), tmp_path / "journal")
    cell.advance()
    before = sample(cell)
    with pytest.raises(ValueError, match=r"0 to 9223372036854775807 \(2\^63 - 1\), got 18446744073709551616"):
        cell.restart(2**64)
    assert sample(cell) == before
    assert revive(CellSettings(), tmp_path / "journal")[0].replayed == 1
