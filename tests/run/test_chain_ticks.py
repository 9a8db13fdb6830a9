"""Ticks of a serial arm in machine code: the rows of a loop in Python to the bit, whatever happens between them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtwin.arm.model import ArmModel
from dtwin.controller.runtime import chosen
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.errors import NativeError
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, ChainSettings, run
from dtwin.run.machine_code.chain import MOST, until
from dtwin.simulation.chain.simulator import ArmSimulator
from dtwin.simulation.chain.whatif import ArmChange
from tests.run.test_chain_sorting import TASK


def same(one: ChainRun, other: ChainRun) -> bool:
    rows = ("t", "q", "target", "command", "true", "pose", "places")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in rows)


def both(settings: ChainSettings) -> tuple[ChainRun, ChainRun]:
    """The run in machine code, and tick by tick, because somebody looks at each."""
    return run(settings), run(settings, beside=lambda *_: None)


@pytest.mark.parametrize("name", ["planar-2r", "six-axis"])
@pytest.mark.parametrize(("machine", "late"), [("ideal", 0), ("nominal", 2), ("31", 1)])
def test_machine_code_leaves_the_rows_of_a_loop_in_python(name: str, machine: str, late: int) -> None:
    fast, slow = both(replace(ArmCell(arm=name, machine=machine, late=late).settings(6.0), seed=5))
    assert len(fast.t) == round(6.0 / fast.settings.arm.period)
    assert np.ptp(fast.true, axis=0).max() > 0.5
    assert same(fast, slow)


@pytest.mark.parametrize("faults", [("K1*=0.8@4.003",), ("freeze2@3-4", "push1+=2@5"), ("friction2*=2@0.01",)])
def test_ticks_before_the_first_fault_are_those_of_a_loop_in_python(faults: tuple[str, ...]) -> None:
    settings = replace(ArmCell(arm="planar-2r", machine="31", late=1).settings(6.0), seed=5)
    fast, slow = both(replace(settings, faults=tuple(parse_chain_fault(fault, 2) for fault in faults)))
    assert same(fast, slow)
    assert not same(fast, run(settings))


def test_boxes_come_and_go_between_ticks_in_machine_code(tmp_path: Path) -> None:
    (tmp_path / "sort.toml").write_text(TASK)
    cell = ArmCell(arm="planar-2r", machine="8", sort=tmp_path / "sort.toml")
    fast, slow = both(cell.settings(20.0))
    assert fast.boxes is not None
    assert fast.boxes.delivered >= 2
    assert fast.boxes == slow.boxes
    assert same(fast, slow)


def looked_at(settings: ChainSettings, every: int) -> list[tuple[int, bytes]]:
    seen: list[tuple[int, bytes]] = []

    def look(blocks: Any, rows: np.ndarray, gripped: np.ndarray, done: int) -> None:
        seen.append((done, rows[:, :done].tobytes() + gripped[:done].tobytes()))

    run(settings, beside=look, every=every)
    return seen


def test_who_looks_on_now_and_then_sees_the_ticks_of_a_loop_in_python(tmp_path: Path) -> None:
    (tmp_path / "sort.toml").write_text(TASK)
    cell = ArmCell(arm="planar-2r", machine="8", sort=tmp_path / "sort.toml", faults=("K1*=0.8@5.5",))
    seen = looked_at(cell.settings(8.0, 3), 20)
    assert [done for done, _ in seen] == list(range(20, 801, 20))
    assert seen == looked_at(cell.settings(8.0, 3), 1)[19::20]


def test_whole_numbers_are_limits_and_constants_as_well() -> None:
    given = ArmCell(arm="planar-2r", machine="nominal").settings(2.0)
    joints = tuple(replace(j, actuator=replace(j.actuator, constant=2, limit=3)) for j in given.machine.arm.joints)
    fast, slow = both(replace(given, machine=replace(given.machine, arm=replace(given.machine.arm, joints=joints))))
    assert np.ptp(fast.true, axis=0).max() > 0.05
    assert same(fast, slow)


@pytest.mark.parametrize("part", ["dtwin.loop.closed_loop", "dtwin.emulation.chain.steps.stepping"])
def test_without_a_compiler_for_the_loop_the_rows_are_the_same(part: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The blocks may be kept from a time when there was one."""

    def refuse() -> None:
        raise NativeError("there is no C compiler")

    given = ArmCell(arm="planar-2r", machine="nominal").settings(2.0)
    start, model = given.poses.positions[0], ArmModel.of(given.arm)
    expected, twin = run(given), ArmSimulator(given, model).run(start, ArmChange(), 2.0)
    monkeypatch.setattr(f"{part}._library", refuse)
    assert same(run(given), expected)
    assert np.array_equal(ArmSimulator(given, model).run(start, ArmChange(), 2.0).q, twin.q)


def test_a_run_ends_with_its_last_pose() -> None:
    given = ArmCell(arm="planar-2r").settings(60.0)
    poses = replace(given.poses, positions=given.poses.positions[:2], again=False)
    fast, slow = both(replace(given, poses=poses))
    assert len(fast.t) < 3000
    assert same(fast, slow)


def test_ticks_in_machine_code_end_before_an_event() -> None:
    period = 0.01
    for event in (0.03, 0.0351, 0.35, 0.9):
        assert event - 3.0 * period < until(0.0, event, period) * period < event
    assert [until(0.0, event, period) for event in (0.0, 0.005, 0.01)] == [0, 0, 0]
    assert until(1.0, np.inf, period) == MOST


def test_the_loop_of_the_twin_is_one_in_machine_code_and_in_python() -> None:
    given = ArmCell(arm="six-axis", machine="nominal", late=1).settings(4.0)
    model, change, start = ArmModel.of(given.arm), ArmChange(pole=10.0, payload=1.0), given.poses.positions[0]
    fast = ArmSimulator(given, model).run(start, change, 3.0)
    with chosen("python"):
        slow = ArmSimulator(given, model).run(start, change, 3.0)
    assert np.ptp(fast.q, axis=0).max() > 0.3
    for name in ("t", "q", "target", "command"):
        assert np.array_equal(getattr(fast, name), getattr(slow, name)), name
    assert (fast.stop, fast.reached) == (slow.stop, slow.reached)
