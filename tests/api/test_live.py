"""A live cell from Python: samples, summary, settings, upload, stop and release."""

from collections.abc import Iterator

import pytest

import dtwin
from dtwin.cli import main
from tests.support.desk import Desk, new_desk
from tests.support.waiting import until


@pytest.fixture(scope="module")
def desk() -> Iterator[Desk]:
    with new_desk() as desk:
        with pytest.raises(dtwin.DtwinError, match="cell 'cell' is not up on this machine"):
            dtwin.connect()
        desk.detach("--pace", "realtime", "--seed", "2", "--simulation", "--history", str(desk.folder / "h.jsonl"))
        yield desk


@pytest.fixture
def cell(desk: Desk) -> Iterator[dtwin.LiveCell]:
    with dtwin.connect() as cell:
        yield cell


def test_samples_come_in_their_order(cell: dtwin.LiveCell) -> None:
    samples = list(cell.samples(50))
    ticks = [each.sequence for each in samples]
    assert len(set(ticks)) == 50
    assert ticks == sorted(ticks)
    assert [each.time for each in samples] == pytest.approx([0.01 * tick for tick in ticks])


def test_samples_that_nobody_takes_are_bounded_and_counted(cell: dtwin.LiveCell) -> None:
    samples = cell.samples(bound=3)
    first, missed = next(samples), cell.missed
    until(lambda: cell.missed > missed + 10, "samples are lost")
    later = next(samples)
    assert later.sequence > first.sequence + 10
    assert list(cell.samples(0)) == []


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"bound": 0}, "bound: expected at least 1, got 0"),
        ({"count": -1}, "count: expected at least 0, got -1"),
        ({"patience": 0}, "patience: expected a time above 0 s, got 0"),
    ],
)
def test_bounds_of_samples_are_checked_at_once(cell: dtwin.LiveCell, given: dict[str, int], said: str) -> None:
    with pytest.raises(dtwin.DtwinError, match=said):
        cell.samples(**given)


def test_an_upload_is_in_force_with_its_reason(cell: dtwin.LiveCell) -> None:
    before = cell.settings()
    after = cell.upload(target_time=1.7, why="faster", who="ada")
    assert after.version == before.version + 1
    assert (after.target_time, cell.settings().target_time) == (1.7, 1.7)
    with pytest.raises(dtwin.DtwinError, match="expected gains, target_time or model"):
        cell.upload(why="nothing")
    with pytest.raises(dtwin.DtwinError, match="version"):
        cell.upload(target_time=1.8, based_on=before.version)


def test_a_fault_is_injected_now_and_told_to_who_comes_later(
    cell: dtwin.LiveCell, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fault", "inject", "D2*=1.01"]) == 0
    assert "injected D2*=1.01@" in capsys.readouterr().out
    before = next(cell.samples(1)).time
    done = cell.inject("D3*=1.01", after=1e6)
    start = float(done.text.partition("@")[2])
    assert before + 1e6 <= start < before + 1e6 + 600
    with pytest.raises(dtwin.DtwinError, match="after: expected"):
        cell.inject("D3*=1.01@5", after=1.0)
    with pytest.raises(dtwin.DtwinError, match="fault 'D9@': expected"):
        cell.inject("D9@")
    until(lambda: any("D2*=1.01" in event.text for event in cell.summary().events), "the fault has begun")
    passed = len(cell.summary().events)
    assert main(["watch", "events", "--count", str(passed)]) == 0
    assert "D2*=1.01" in capsys.readouterr().out


def test_a_stop_lasts_until_its_release(cell: dtwin.LiveCell) -> None:
    assert cell.stop("a hand in the way").stop != "none"
    until(lambda: cell.release("clear").stop == "none", "the arm may move again")
    assert cell.summary().services["bridge"].restarts == 0
