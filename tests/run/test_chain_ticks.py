"""Ticks of a serial arm in machine code: the rows of a loop in Python to the bit, whatever happens between them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.model import ArmModel
from dtwin.controller.runtime import chosen
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, ChainSettings, run
from dtwin.run.machine_code.chain import MOST, until
from dtwin.simulation.chain.simulator import ArmSimulator
from dtwin.simulation.chain.whatif import ArmChange

SORT = """
pick = [0.3, 0.0, 0.2]
height = 0.1
mass = [0.2, 0.4]
every = 0.5
[places]
blue = [0.0, 0.0, 0.4]
red = [-0.3, 0.0, 0.1]
"""


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


def test_boxes_come_and_go_between_ticks_in_machine_code(tmp_path: Path) -> None:
    (tmp_path / "sort.toml").write_text(SORT)
    cell = ArmCell(arm="planar-2r", machine="8", sort=tmp_path / "sort.toml")
    fast, slow = both(cell.settings(20.0))
    assert fast.boxes is not None
    assert fast.boxes.delivered >= 2
    assert fast.boxes == slow.boxes
    assert same(fast, slow)


def test_a_run_ends_with_its_last_pose() -> None:
    given = ArmCell(arm="planar-2r").settings(60.0)
    poses = replace(given.poses, positions=given.poses.positions[:2], again=False)
    fast, slow = both(replace(given, poses=poses))
    assert len(fast.t) < 3000
    assert same(fast, slow)


def test_ticks_in_machine_code_end_before_an_event() -> None:
    period = 0.01
    for event in (0.0, 0.005, 0.01, 0.35, 3.0):
        assert until(0.0, event, period) * period <= event
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
