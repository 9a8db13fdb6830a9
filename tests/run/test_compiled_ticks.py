"""Ticks in machine code: the same log, events and state as ticks in Python, to the bit."""

from __future__ import annotations

import pytest

from dtwin.emulation.faults import parse_fault
from dtwin.errors import DivergenceError
from dtwin.parameters import ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from tests.support.iec61499.c_harness import needs_compiler

pytestmark = needs_compiler


def faults(*texts: str) -> CellSettings:
    return CellSettings(14.0, seed=1, noise=0.001, faults=tuple(map(parse_fault, texts)))


SETTINGS = {
    "exact": CellSettings(20.0),
    "noisy": CellSettings(50.0, seed=3, noise=0.002, noise_kind="gaussian"),
    "faults of the arm": faults("K2*=0.5@3", "lock1@9-9.5", "push2+=0.3@10-10.1"),
    "faults of encoders": faults("freeze1@3-5", "bias2+=0.01@6.005-8"),
    "faults of commands": faults("late@3-5", "cut3@6-7", "supply*=0.8@8-9"),
    "a machine": CellSettings(3.0, arm=ArmParameters().with_values({"mu1": 0.001})),
}


def in_python(settings: CellSettings, monkeypatch: pytest.MonkeyPatch) -> Cell:
    cell = Cell(settings)
    monkeypatch.setattr(cell, "_ahead", lambda: None)
    return cell


@pytest.mark.parametrize("name", SETTINGS)
def test_the_run_is_the_same(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cells = Cell(SETTINGS[name]), in_python(SETTINGS[name], monkeypatch)
    for cell in cells:
        cell.run()
    first, second = (cell.log.freeze() for cell in cells)
    for column in first.columns:
        assert first.columns[column].tobytes() == second.columns[column].tobytes(), column
    assert first.events == second.events
    assert cells[0].emulation.state() == cells[1].emulation.state()
    assert cells[0].emulation.box_counts == cells[1].emulation.box_counts


def test_a_run_that_is_cut_short_has_the_ticks_before(monkeypatch: pytest.MonkeyPatch) -> None:
    cells = Cell(CellSettings(5.0)), in_python(CellSettings(5.0), monkeypatch)
    seen: list[list[int]] = [[], []]
    for cell, done in zip(cells, seen, strict=True):

        def between(ticks: int, done: list[int] = done) -> bool:
            done.append(ticks)
            return ticks < 300

        cell.run(between)
    assert seen[0] == seen[1] == [100, 200, 300]
    assert len(cells[0].log) == len(cells[1].log) == 300
    assert cells[0].emulation.state() == cells[1].emulation.state()


def test_an_arm_that_diverges_ends_both_runs_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    wild = CellSettings(5.0, arm=ArmParameters().with_values({"D1": 1e6}))
    messages, rows = [], []
    for cell in (Cell(wild), in_python(wild, monkeypatch)):
        with pytest.raises(DivergenceError) as caught:
            cell.run()
        messages.append(str(caught.value))
        rows.append(cell.log.freeze().columns["theta_1"].tobytes())
    assert messages[0] == messages[1]
    assert rows[0] == rows[1]
