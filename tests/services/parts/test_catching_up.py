"""A recorder that comes back asks for what it missed, and its rows are those of one that was never away."""

from collections.abc import Iterator

import pytest

from dtwin.bus.messages import (
    ACTED,
    ANSWER_BACKLOG,
    PATH,
    SAMPLE_BACKLOG,
    SENSORS,
    TRUTH,
    VOLTAGES,
    Acted,
    BacklogRequest,
    Path,
)
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.services.parts.missed.backlog import KEPT, Kept, answers, samples
from dtwin.services.parts.missed.catching_up import catch_up
from dtwin.services.parts.rows import Rows
from dtwin.signals import Sensors, StepRecord, Truth, Voltages
from tests.support.ports import free_port

TICKS = 450
ZERO = (0.0, 0.0, 0.0)


class Cell:
    """An emulator and a bridge of which only what they publish is there."""

    def __init__(self, bus: Bus) -> None:
        self.kept = [Kept(bus.publisher(topic)) for topic in (SENSORS, TRUTH, ACTED)]
        self.answered = [Kept(bus.publisher(topic)) for topic in (VOLTAGES, PATH)]
        bus.answer(SAMPLE_BACKLOG, BacklogRequest, lambda asked: samples(asked, *self.kept))
        bus.answer(ANSWER_BACKLOG, BacklogRequest, lambda asked: answers(asked, *self.answered))

    def pass_tick(self, number: int) -> None:
        """A tick whose command is late once in a while."""
        time = 0.01 * number
        sensors, truth, acted = self.kept
        voltages, path = self.answered
        sensors(Sensors(number, time, (0.001 * number, 0.0, 0.0), 0.0, False, ""))
        truth(Truth(time, ZERO, ZERO, 0.0, 0.0))
        voltages(Voltages(number, time, (0.01 * number, 0.0, 0.0, 0.0), False))
        path(Path(number, time, (0.002 * number, 0.0, 0.0)))
        if number % 7 == 3:
            acted(Acted(number, time, (-1.0, 0.0, 0.0, 0.0), False))


@pytest.fixture
def buses() -> Iterator[tuple[Bus, Bus]]:
    meet = f"tcp/127.0.0.1:{free_port()}"
    with Bus(open_peer(meet)) as cell, Bus(open_peer(meet)) as recorder:
        yield cell, recorder


def rows_of(found: list[StepRecord]) -> Rows:
    return Rows(found.append, lambda: False)


def test_what_was_missed_is_caught_in_order(buses: tuple[Bus, Bus]) -> None:
    cell = Cell(buses[0])
    for number in range(TICKS):
        cell.pass_tick(number)
    found: list[StepRecord] = []
    rows = rows_of(found)
    caught = catch_up(buses[1], rows, 20, 0.0)
    rows.flush()
    assert sorted(caught) == list(range(20, TICKS))
    assert [record.sensors.sequence for record in found] == list(range(20, TICKS))
    for record in found:
        number = record.sensors.sequence
        assert record.voltages.volts[0] == (-1.0 if number % 7 == 3 else 0.01 * number)
        assert record.target[0] == 0.002 * number
        assert record.truth.time == record.sensors.time
    assert rows.late == 0


def test_only_the_last_messages_are_kept(buses: tuple[Bus, Bus]) -> None:
    cell = Cell(buses[0])
    for number in range(KEPT + 100):
        cell.pass_tick(number)
    assert cell.kept[0].page(0) == ()
    assert len(cell.kept[0].messages) == KEPT
    assert cell.kept[0].page(100)[0].sequence == 100


def test_nobody_who_answers_leaves_the_rows_as_they_were(
    buses: tuple[Bus, Bus], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dtwin.services.parts.missed.catching_up._PATIENCE", 0.2)
    found: list[StepRecord] = []
    assert catch_up(buses[1], rows_of(found), 0, 0.0) == {}
    assert found == []
