"""A cell with a journal goes on to the bit after a kill, wherever the last checkpoint lies."""

from dataclasses import replace
from pathlib import Path

import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.faults import parse_fault
from dtwin.errors import RecordingError
from dtwin.run.cell import CellSettings
from dtwin.services.parts.journal import ROTATION, Journal
from dtwin.services.parts.journaled import NO_COMMAND, JournaledCell
from dtwin.signals import Event, Sensors, Truth, Voltages

SETTINGS = CellSettings(seed=3, noise=0.002, noise_kind="gaussian", faults=(parse_fault("D1*=1.2@40-70"),))
INJECTED = 3000
"""Tick at which a fault is injected."""
KILLED = ROTATION + 1234
"""Tick at which the cell is killed."""
END = KILLED + 800


def tick(cell: JournaledCell, command: Voltages) -> tuple[Sensors, Truth, list[Event]]:
    if cell.emulation.read().sequence == INJECTED:
        cell.inject(["K3*=0.95@1-90"])
    cell.obey(command)
    cell.advance()
    return cell.emulation.read(), cell.emulation.truth(), cell.emulation.drain_events()


def test_a_cell_that_was_killed_after_a_checkpoint_goes_on_to_the_bit(tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    undisturbed, controller = JournaledCell(SETTINGS, None), EmbeddedController()
    killed = JournaledCell(SETTINGS, Journal(journal, SETTINGS.seed))
    commands, expected = [], []
    for _ in range(END):
        commands.append(controller.step(undisturbed.emulation.read()))
        expected.append(tick(undisturbed, commands[-1]))
    for command in commands[:KILLED]:
        tick(killed, command)
    again = JournaledCell(replace(SETTINGS, seed=99), Journal(journal, 99))
    assert again.seed == SETTINGS.seed
    assert 0 < again.replayed < KILLED
    assert again.command.volts == commands[KILLED - 1].volts
    assert (again.emulation.read(), again.emulation.truth()) == expected[KILLED - 1][:2]
    assert [tick(again, command) for command in commands[KILLED:]] == expected[KILLED:]
    assert again.emulation.box_counts == undisturbed.emulation.box_counts
    assert undisturbed.emulation.box_counts.delivered > 0
    assert journal.stat().st_size < 250_000


def test_a_checkpoint_that_is_none_is_refused(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal", 0)
    journal.checkpoint(b"nonsense")
    with pytest.raises(RecordingError, match="state of an emulated cell"):
        JournaledCell(SETTINGS, Journal(tmp_path / "journal", 0))


def test_an_arm_without_torque_goes_on_pressing_the_box_that_it_holds() -> None:
    """What the latch takes off is the arm's: a gripper without voltage lets its box go at the next knock."""
    cell = JournaledCell(CellSettings(), None)
    for gripped, gripper in ((True, -8.0), (False, 0.0)):
        cell.obey(Voltages(1, 0.01, (1.0, 2.0, 3.0, -8.0), gripped))
        for _ in range(2):
            cell.stop()
            assert cell.command == Voltages(1, 0.01, (0.0, 0.0, 0.0, gripper), gripped)
    cell.obey(Voltages(1, 0.01, (1.0, 2.0, 3.0, -3.0), True))
    for pressing, gripper in ((3.0, -3.0), (-8.0, -8.0), (-3.0, -8.0)):
        cell.stop(pressing)
        assert cell.command == Voltages(1, 0.01, (0.0, 0.0, 0.0, gripper), True), "pressed harder, and never let go"
    cell.latch.stop("torque off", b"")
    cell.restart(5)
    assert (cell.command, cell.latch.latched.stop) == (NO_COMMAND, "torque off")
