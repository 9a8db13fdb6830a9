"""What may be a consequence of what was found before it: it is answered once it is none."""

from typing import Any

import pytest

from dtwin.recovery.desk import LASTS
from dtwin.signals import Event, EventKind
from tests.recovery.fake_cell import HEALTHY, TICK, FakeCell, measures_of, watched


@pytest.fixture
def cell() -> FakeCell:
    """A motor has become weak at 20 s, and something may follow from that at 25 s."""
    cell = FakeCell()
    cell.found["K2"], cell.refits["K2"] = (20.0, -0.1, 0.01), 0.9 * HEALTHY.get("K2")
    return cell


def followed(cell: FakeCell, name: str) -> None:
    cell.found[name], cell.follows[name] = (25.0, 0.001, 1e-4), "K2"


def withdrawn(cell: FakeCell, findings: dict[str, Any], name: str, time: float) -> None:
    """Lets a finding end at a time, s."""

    def change() -> None:
        if cell.time >= time:
            findings.pop(name, None)

    cell.changing = change


def stopped(cell: FakeCell) -> list[float]:
    """When the arm was stopped, and why it was is the last that was told."""
    return [step.time for step in watched(cell).steps if step.measure == "stop"]


@pytest.mark.parametrize("name", ["drift2", "unknown3", "lock1"])
def test_a_consequence_that_is_withdrawn_stops_no_arm(cell: FakeCell, name: str) -> None:
    followed(cell, name)
    withdrawn(cell, cell.found, name, 35.0)
    assert measures_of(watched(cell)) == [("refit", ("K2",))]


def test_what_turns_out_to_be_no_consequence_stops_the_arm(cell: FakeCell) -> None:
    followed(cell, "drift2")
    withdrawn(cell, cell.follows, "drift2", 35.0)
    assert stopped(cell) == [35.0]


def test_a_consequence_that_stays_stops_the_arm_at_last(cell: FakeCell) -> None:
    followed(cell, "drift2")
    assert stopped(cell) == [pytest.approx(25.0 + LASTS, abs=TICK)]


def test_an_encoder_that_has_stopped_is_waited_for_by_nobody(cell: FakeCell) -> None:
    followed(cell, "freeze2")
    assert stopped(cell) == [25.0]


def test_a_consequence_may_tell_why_the_blocks_have_stopped_the_arm(cell: FakeCell) -> None:
    followed(cell, "lock1")
    cell.events = [Event(28.0, EventKind.STOP, "safe stop: braking (it left its path)")]
    assert stopped(cell) == [pytest.approx(28.0, abs=TICK)]
    assert "free joint 1" in cell.told[-1]


def test_friction_that_may_be_a_consequence_is_refitted_once_it_is_none(cell: FakeCell) -> None:
    followed(cell, "D3")
    cell.refits["D3"] = HEALTHY.get("D3") + 0.001
    withdrawn(cell, cell.follows, "D3", 40.0)
    operator = watched(cell)
    assert measures_of(operator) == [("refit", ("K2",)), ("refit", ("D3",))]
    assert operator.steps[1].time >= 40.0
